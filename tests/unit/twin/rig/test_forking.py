"""Cases that go on with other random numbers from a moment on."""

from __future__ import annotations

import numpy as np
import pytest
from case_changes import changed

from schemas.case import Case
from schemas.identity import case_digest, rig_key, stack_seed
from schemas.messages import Command, Detection, Lights
from schemas.plan import expand, parse_campaign
from schemas.sections.fork import Fork
from twin.rig.engine import Engine
from twin.rig.slot import Finished
from twin.vehicle.columns import COLUMN

NOISY = {
    "imu": {"hz": 20},
    "gnss": {"hz": 20, "dropouts_per_min": 30},
    "radar": {"hz": 20},
    "encoders": {"hz": 20},
}
TICKS, FORK = 12, 5
_DTC = COLUMN["dtc_m"]


def noisy_case(name: str = "a", **scenario: object) -> Case:
    """A case in which all that draws random numbers does."""
    data = {
        "campaign": "test",
        "seed": 4,
        "control_hz": 20,
        "camera": {"width": 32, "height": 18, "hz": 20},
        "lidars": [{"name": "roof", "hz": 20}],
        "sensors": NOISY,
        "scenario": {"ego_start_m": 40.0, "ego_speed_mps": 8.0, "duration_s": 3.0, **scenario},
        "autonomy": {"latency_jitter_ms": 180, "drop": 0.3},
        "matrix": {"weather": ["heavy_rain"]},
    }
    campaign, mistakes = parse_campaign(data)
    assert campaign is not None, mistakes
    return changed(expand(campaign)[0], id=name)


def driven(engine: Engine, slot: int, case: Case, ticks: int) -> dict[str, list[bytes]]:
    """Readings of a slot, tick by tick, and the state of its vehicle."""
    engine.reset(slot, case)
    seen: dict[str, list[bytes]] = {"state": []}
    for tick in range(ticks):
        for name, data in engine.sense().items():
            valid = slice(None) if data.count is None else slice(int(data.count[slot]))
            seen.setdefault(name, []).append(data.values[slot][valid].tobytes())
        seen["state"].append(engine.state[slot].tobytes())
        commands: list[Command | None] = [None] * engine.slots
        commands[slot] = Command(slot, 0, tick, 0.4, 0.0, 0.01 * (tick % 3))
        assert not engine.step(commands)
    engine.clear(slot)
    return seen


@pytest.fixture(scope="module")
def engine() -> Engine:
    return Engine(noisy_case(), 2)


def test_a_fork_shares_the_beginning_and_draws_everything_anew_from_its_tick_on(
    engine: Engine,
) -> None:
    parent = driven(engine, 0, noisy_case(), TICKS)
    forked = changed(noisy_case("b"), forks=[Fork(case="a"), Fork(case="b", tick=FORK)])
    child = driven(engine, 1, forked, TICKS)
    for name, before in parent.items():
        assert child[name][:FORK] == before[:FORK], name
    for name in ("camera", "lidar.roof", "radar", "imu", "gnss"):
        assert child[name][FORK] != parent[name][FORK], name
    assert child["state"][-1] != parent["state"][-1], "neither wind nor losses were drawn anew"
    again = driven(engine, 0, forked, TICKS)
    assert again == child


def test_a_case_that_forks_at_once_is_the_case_whose_name_it_has(engine: Engine) -> None:
    plain = driven(engine, 0, noisy_case("b"), 4)
    # The camera keeps its drops and clouds, which are those of the start.
    forked = changed(noisy_case("c"), forks=[Fork(case="a"), Fork(case="b")])
    child = driven(engine, 0, forked, 4)
    for name in ("lidar.roof", "radar", "imu", "gnss", "state"):
        assert child[name] == plain[name], name


def test_a_fork_waits_until_its_column_has_passed_the_limit(engine: Engine) -> None:
    parent = noisy_case()
    engine.reset(0, parent)
    distances = []
    for tick in range(TICKS):
        engine.sense()
        distances.append(float(engine.state[0, _DTC]))
        engine.step([Command(0, 0, tick, 0.4, 0.0, 0.01 * (tick % 3)), None])
    engine.clear(0)
    before = driven(engine, 0, parent, TICKS)
    # The row of tick FORK - 1 is the first that is smaller: the next reading is another.
    margin = distances[FORK - 2] - 1.0
    at = {"column": "dtc_m", "limit": 1.0}
    waits = Fork(case="b", margin=margin, **at)
    later = Fork(case="c", margin=distances[FORK - 1] - 1.0, **at)
    forked = changed(noisy_case("b"), forks=[Fork(case="a"), waits])
    child = driven(engine, 0, forked, TICKS)
    assert child["imu"][:FORK] == before["imu"][:FORK]
    assert child["imu"][FORK] != before["imu"][FORK]
    twice = driven(engine, 1, changed(forked, forks=[Fork(case="a"), waits, later]), TICKS)
    assert twice["imu"][: FORK + 1] == child["imu"][: FORK + 1]
    assert twice["imu"][FORK + 1] != child["imu"][FORK + 1]
    never = Fork(case="b", margin=-1e9, **at)
    alone = driven(engine, 0, changed(forked, forks=[Fork(case="a"), never]), TICKS)
    assert alone == before


def test_a_fork_is_part_of_what_a_case_is_and_not_of_its_rig() -> None:
    parent = noisy_case()
    root = changed(parent, forks=[Fork(case="a")])
    late = changed(parent, forks=[Fork(case="a"), Fork(case="b", tick=7)])
    assert len({case_digest(case) for case in (parent, root, late)}) == 3
    assert rig_key(late) == rig_key(parent)
    child = changed(late, id="b")
    assert stack_seed(child) == stack_seed(parent) != stack_seed(noisy_case("b"))


def test_margins_count_towards_the_limit() -> None:
    assert Fork(case="a", limit=2.0).margin_of(3.0) == 1.0
    assert Fork(case="a", limit=2.0, above=True).margin_of(-3.0) == 5.0
    assert Fork(case="a", limit=2.0, above=True, size=True).margin_of(-3.0) == -1.0
    assert np.isnan(Fork(case="a").margin_of(float("nan")))


def _to_the_end(engine: Engine, slot: int, ticks: int, brake: int = 15) -> Finished:
    """Drive on, and brake in the end."""
    for _ in range(ticks):
        engine.sense()
        commands = [
            _command(engine, s, brake) if engine.active[s] else None for s in range(engine.slots)
        ]
        for finished in engine.step(commands):
            if finished.slot == slot:
                return finished
    raise AssertionError("the case does not end")


def _command(engine: Engine, slot: int, brake: int = 15) -> Command:
    tick = int(engine.tick[slot])
    detected = [Detection("car", 0.5, 1.0, 2.0, 3.0, 4.0)] if tick % 3 == 0 else []
    lights = Lights(low=tick % 4 == 0, indicators=1)
    pedals = (0.0, 0.7) if tick > brake else (0.4, 0.0)
    return Command(
        slot,
        0,
        tick,
        *pedals,
        0.01 * (tick % 3),
        aeb=tick > brake,
        lights=lights,
        detections=detected,
    )


def _bytes(finished: Finished) -> bytes:
    table = finished.table
    parts = [table.columns[name].values.tobytes() for name in sorted(table.columns)]
    parts += [c.valid.tobytes() for c in table.columns.values() if c.valid is not None]
    parts.append(repr((finished.scalars, finished.verdict, finished.reasons)).encode())
    return b"".join(parts) + repr(table.to_lists()["detections"]).encode()


def _read(engine: Engine, slot: int, ticks: int) -> list[bytes]:
    seen = []
    for _ in range(ticks):
        for data in engine.sense().values():
            valid = slice(None) if data.count is None else slice(int(data.count[slot]))
            seen.append(data.values[slot][valid].tobytes())
        engine.step(
            [_command(engine, s) if engine.active[s] else None for s in range(engine.slots)]
        )
    return seen


def test_a_saved_case_goes_on_elsewhere_as_if_nothing_had_been(engine: Engine) -> None:
    case = noisy_case()
    other = Engine(case, 3)
    engine.reset(1, case)
    _read(engine, 1, FORK)
    saved = engine.saver().save(1)
    here = _read(engine, 1, 8)
    straight = _to_the_end(engine, 1, 80)
    other.reset(0, noisy_case("neighbour"))
    _read(other, 0, 2)
    other.saver().restore(2, saved)
    assert int(other.tick[2]) == FORK
    assert _read(other, 2, 8) == here
    assert _bytes(_to_the_end(other, 2, 80)) == _bytes(straight)
    other.close()


def test_a_fork_of_a_saved_case_is_the_fork_that_began_at_its_start(engine: Engine) -> None:
    case = noisy_case()
    forked = changed(noisy_case("b"), forks=[Fork(case="a"), Fork(case="b", tick=FORK + 2)])
    twice = changed(
        noisy_case("c"),
        forks=[Fork(case="a"), Fork(case="b", tick=FORK + 2), Fork(case="c", tick=FORK + 4)],
    )
    engine.reset(0, forked)
    straight = _to_the_end(engine, 0, 80)
    engine.reset(0, twice)
    straight_twice = _to_the_end(engine, 0, 80)
    engine.reset(0, case)
    _read(engine, 0, FORK)
    saved = engine.saver().save(0)
    engine.clear(0)
    engine.saver().restore(1, saved, forked)
    _read(engine, 1, 3)
    later = engine.saver().save(1)
    assert _bytes(_to_the_end(engine, 1, 80)) == _bytes(straight)
    engine.saver().restore(0, later, twice)
    assert _bytes(_to_the_end(engine, 0, 80)) == _bytes(straight_twice)
    assert _bytes(straight) != _bytes(straight_twice)


def test_the_way_along_a_lane_is_saved() -> None:
    data = {
        "campaign": "test",
        "seed": 4,
        "control_hz": 20,
        "render": False,
        "scenario": {"type": "lane_keeping", "scene": "downtown-loop", "ego_speed_mps": 9.0}
        | {"duration_s": 3.0},
        "autonomy": {"stack": "devkit.idle:IdleStack"},
        "matrix": {"weather": ["heavy_snow"]},
    }
    campaign, mistakes = parse_campaign(data)
    assert campaign is not None, mistakes
    [case] = expand(campaign)
    engine = Engine(case, 2)
    engine.reset(0, case)
    for _ in range(17):
        engine.sense()
        assert not engine.step([_command(engine, 0), None])
    saved = engine.saver().save(0)
    straight = _to_the_end(engine, 0, 80)
    assert (straight.scalars["distance_m"] or 0.0) > 5.0
    engine.saver().restore(1, saved)
    assert _bytes(_to_the_end(engine, 1, 80)) == _bytes(straight)
    engine.close()


def _storyboard_case(storyboard: str, **scenario: object) -> Case:
    data = {
        "campaign": "test",
        "seed": 4,
        "control_hz": 20,
        "render": False,
        "sensors": {"imu": {"hz": 20}, "radar": {"hz": 20}},
        "scenario": {
            "type": "storyboard",
            "storyboard": storyboard,
            "scene": "motorway",
            "numbers": {"end.after_s": 9.0},
            **scenario,
        },
        "autonomy": {"stack": "devkit.idle:IdleStack"},
        "matrix": {"weather": ["heavy_rain"]},
    }
    campaign, mistakes = parse_campaign(data)
    assert campaign is not None, mistakes
    return changed(expand(campaign)[0], id=storyboard)


@pytest.mark.parametrize("driver", ["stack", "robot"])
def test_a_scenario_and_its_bodies_are_saved(driver: str) -> None:
    case, other = (_storyboard_case(name, driver=driver) for name in ("cut-in", "cut-out"))
    engine, elsewhere = Engine(case, 1), Engine(other, 2)
    for ticks in (14, 60):
        engine.reset(0, case)
        for _ in range(ticks):
            engine.sense()
            assert not engine.step([_command(engine, 0, 150)])
        saved = engine.saver().save(0)
        here = _read(engine, 0, 5)
        straight = _to_the_end(engine, 0, 400, 150)
        elsewhere.reset(0, other)
        elsewhere.saver().restore(1, saved)
        assert _read(elsewhere, 1, 5) == here
        assert _bytes(_to_the_end(elsewhere, 1, 400, 150)) == _bytes(straight)
        elsewhere.clear(0)
    assert straight.scalars["events_started"]
    engine.close()
    elsewhere.close()


def test_what_is_no_fork_of_a_saved_case_is_refused_in_a_line(engine: Engine) -> None:
    case = noisy_case()
    engine.reset(0, case)
    _read(engine, 0, FORK)
    saver = engine.saver()
    saved = saver.save(0)
    engine.clear(0)
    late = changed(case, id="b", forks=[Fork(case="a"), Fork(case="b", tick=FORK - 1)])
    dtc_m = saved.parts["rows"]["values"]["dtc_m"]
    passed = Fork(case="b", column="dtc_m", margin=float(dtc_m[1]) + 1e-9)
    for wrong, why in (
        (late, "forks from a before tick 5"),
        (changed(case, id="b", forks=[Fork(case="a"), passed]), "forks from a before tick 5"),
        (changed(case, id="b"), "is no fork of a"),
        (changed(case, id="b", weather="clear", forks=[Fork(case="a")]), "is no fork of a"),
        (changed(case, view="record"), "is of another rig than a"),
    ):
        with pytest.raises(ValueError, match=why):
            saver.restore(1, saved, wrong)
    ripe = Fork(case="b", column="dtc_m", margin=float(dtc_m[-2]))
    saver.restore(1, saved, changed(case, id="b", forks=[Fork(case="a"), ripe]))
    engine.clear(1)
