"""The section ``autonomy`` with a stack in a process of its own."""

import pytest

from schemas.identity import rig_key
from schemas.plan import expand, parse_campaign


def check(autonomy, **sections):
    data = {"campaign": "c", "matrix": {"weather": ["clear"]}, "autonomy": autonomy, **sections}
    campaign, mistakes = parse_campaign(data)
    return campaign, [mistake.line("c.yaml") for mistake in mistakes]


BRIDGED = {
    "sensors": {"encoders": {}, "imu": {}, "pose": {}},
    "cameras": [{"name": "front_left"}],
}


def test_a_command_drives_one_car_unless_it_says_otherwise():
    campaign, _ = check({"command": ["run", "--fast"]})
    (case,) = expand(campaign)
    assert case.rig.stack == ""
    assert case.rig.foreign.command == ["run", "--fast"]
    assert [case.rig.slots_of(n) for n in (1, 16)] == [1, 1]
    campaign, _ = check({"command": ["run"], "slots": 4})
    assert [expand(campaign)[0].rig.slots_of(n) for n in (1, 16)] == [1, 4]
    campaign, _ = check({"stack": "a:B"})
    (plain,) = expand(campaign)
    assert plain.rig.slots_of(16) == 16
    assert len({rig_key(c) for c in (case, expand(campaign)[0])}) == 2


def test_a_bridge_is_a_stack_of_ours_with_a_command():
    campaign, mistakes = check({"command": ["run"], "bridge": "autodrive"}, **BRIDGED)
    assert not mistakes
    (case,) = expand(campaign)
    assert case.rig.stack == "devkit.bridges.autodrive:AutodriveBridge"
    assert case.rig.slots_of(8) == 1


@pytest.mark.parametrize(
    ("autonomy", "sections", "line"),
    [
        ({"command": ["x"], "stack": "a:B"}, {}, "autonomy.command: given beside stack"),
        ({"command": [""]}, {}, "autonomy.command"),
        ({"bridge": "autodrive"}, BRIDGED, "autonomy.bridge: needs the command"),
        ({"image": {"path": "/i"}}, {}, "autonomy.image: needs the command"),
        ({"repository": {"url": "u"}}, {}, "autonomy.repository: needs the command"),
        ({"command": ["x"], "repository": {}}, {}, "autonomy.repository"),
        (
            {"command": ["x"], "repository": {"url": "https://token@example.org/x.git"}},
            {},
            "autonomy.repository.url: has a user or password in it",
        ),
        ({"command": ["x"], "image": {"path": "/i", "runtime": "docker"}}, {}, "docker"),
        (
            {"command": ["x"], "bridge": "autodrive", "slots": 2},
            BRIDGED,
            "autonomy.slots: given 2, a bridge drives 1",
        ),
        (
            {"command": ["x"], "bridge": "autodrive"},
            {**BRIDGED, "sensors": {"imu": {}}},
            "sensors: the bridge sends them; add encoders: {}, pose: {}",
        ),
        (
            {"command": ["x"], "bridge": "autodrive"},
            {**BRIDGED, "cameras": []},
            "cameras: the bridge sends pictures of front_left and front_right",
        ),
    ],
)
def test_what_does_not_fit_together_is_named(autonomy, sections, line):
    campaign, mistakes = check(autonomy, **sections)
    assert campaign is None
    assert line in " | ".join(mistakes)
