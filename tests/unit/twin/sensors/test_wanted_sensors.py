"""Sensors that nobody looks at are left out; what somebody looks at keeps its bytes."""

import numpy as np
import pytest

from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from twin.rig.engine import Engine
from twin.sensors.wanted import NOTHING, together

FIRST = frozenset(["camera", "boxes", "vehicle"])
"""What the reference stack looks at, and nothing of the other camera, the lidar and the radar."""
FIRST_ALONE = {"camera", "boxes", "flow"}


def case(**more):
    campaign, mistakes = parse_campaign(
        {
            "schema": 1,
            "campaign": "c",
            "scenario": {"ego_start_m": 40, "ego_speed_mps": 10, "duration_s": 4},
            "camera": {"width": 48, "height": 28, "hz": 10, "noise": True, "outputs": ["flow"]},
            "cameras": [{"name": "front_left", "width": 32, "height": 18, "hz": 20}],
            "lidars": [{"name": "roof"}],
            "sensors": {"radar": {}, "radar_cube": {}, "imu": {}},
            "matrix": {"weather": ["heavy_rain"]},
            **more,
        }
    )
    assert not mistakes
    return expand(campaign)[0]


CASE = case()


def drive(wanted, ticks=8, slots=1):
    """Readings of the first slot per tick, their bytes by name, and where the car ended."""
    engine = Engine(CASE, slots)
    for slot in range(slots):
        engine.reset(slot, CASE)
    seen = []
    for tick in range(ticks):
        sensed = engine.sense(wanted(tick))
        seen.append({name: data.values[0].tobytes() for name, data in sensed.items()})
        commands = [Command(slot, 0, tick, 0.2, 0.0, 0.01) for slot in range(slots)]
        assert not engine.step(commands)
    return seen, engine.state[0].tobytes()


@pytest.fixture(scope="module")
def everything():
    return drive(lambda tick: None)


def test_all_is_read_where_nobody_says_less(everything):
    seen, _ = everything
    assert {"camera.front_left", "lidar.roof", "radar", "radar_cube", "imu"} | FIRST <= set(seen[0])


def test_what_is_wanted_has_the_same_bytes_and_the_rest_is_not_there(everything):
    seen, state = drive(lambda tick: FIRST)
    assert state == everything[1]
    others = {"camera.front_left", "boxes.front_left", "lidar.roof", "radar", "radar_cube"}
    for some, full in zip(seen, everything[0], strict=True):
        assert set(some) == set(full) - others, "rows of numbers always come"
        assert some == {name: full[name] for name in some}
    assert sum("camera" in some for some in seen) == 4, "ten per second, at ticks of 50 ms"


def test_a_sensor_that_is_made_of_another_brings_it_along(everything):
    seen, _ = drive(lambda tick: frozenset(["radar_cube"]), ticks=4)
    for some, full in zip(seen, everything[0], strict=False):
        assert some.get("radar_cube") == full.get("radar_cube")
        assert "camera" not in some


def test_nobody_looks(everything):
    seen, state = drive(lambda tick: NOTHING)
    assert state == everything[1]
    assert all(set(some) == {"vehicle", "environment", "imu"} & set(some) for some in seen)
    assert all("vehicle" in some for some in seen)


def test_who_looks_for_a_while_changes_nothing_for_others(everything):
    """A viewer comes at tick 2 and goes at tick 6; the stack's pictures, with their flow between
    one and the next, are those of always."""
    seen, state = drive(lambda tick: None if 2 <= tick < 6 else FIRST)
    assert state == everything[1]
    for tick, (some, full) in enumerate(zip(seen, everything[0], strict=True)):
        for name in FIRST_ALONE & set(full):
            assert some[name] == full[name], (tick, name)
        watched = 2 <= tick < 6
        assert ("lidar.roof" in some) == (watched and "lidar.roof" in full)
        assert ("camera.front_left" in some) == (watched and "camera.front_left" in full)


def test_flow_begins_anew_after_a_time_without_pictures(everything):
    """The picture before is not the one of 0.3 s ago."""
    look = frozenset(["flow"])
    seen, _ = drive(lambda tick: look if tick in (0, 6) else NOTHING)
    assert [tick for tick, some in enumerate(seen) if "flow" in some] == [0, 6]
    assert largest_px(everything[0][6]["flow"]) > 0.1
    assert largest_px(seen[0]["flow"]) < 1e-4
    assert largest_px(seen[6]["flow"]) < 1e-4


def largest_px(flow):
    return np.abs(np.nan_to_num(np.frombuffer(flow, "<f4"))).max()


def test_wishes_together():
    assert together([]) == NOTHING
    assert together([frozenset("a"), frozenset("bc")]) == frozenset("abc")
    assert together([frozenset("a"), None, NOTHING]) is None
