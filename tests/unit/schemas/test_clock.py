"""The campaign key ``clock``."""

import pytest

from schemas.identity import case_digest, rig_key
from schemas.plan import expand, parse_campaign


def check(**sections):
    data = {"campaign": "c", "matrix": {"weather": ["clear"]}, **sections}
    campaign, mistakes = parse_campaign(data)
    return campaign, [mistake.line("c.yaml") for mistake in mistakes]


def test_a_rig_has_one_slot_and_shares_nothing_with_the_lockstep():
    campaign, mistakes = check(clock="realtime")
    assert not mistakes
    (paced,), (plain,) = expand(campaign), expand(check()[0])
    assert [paced.rig.slots_of(n) for n in (1, 16)] == [1, 1]
    assert plain.rig.slots_of(16) == 16
    assert rig_key(paced) != rig_key(plain)
    assert case_digest(paced) != case_digest(plain)


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"simulator": "noop"}, "clock: realtime needs simulator warp"),
        ({"recording": {"drive": "all"}}, "recording.drive: a stack cannot be shown a drive again"),
        ({"autonomy": {"placement": "inline"}}, "autonomy.placement: inline waits for the stack"),
        ({"autonomy": {"command": ["run"], "slots": 2}}, "autonomy.slots: given 2, a rig of clock"),
        ({"matrix": {"clock": ["lockstep"]}}, "matrix.clock: unknown axis"),
    ],
)
def test_what_waits_for_the_stack_is_refused(sections, words):
    _, mistakes = check(**{"clock": "realtime", **sections})
    assert len(mistakes) == 1
    assert words in mistakes[0]
