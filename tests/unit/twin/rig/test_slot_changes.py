"""Slots that are held, and what a hand changes between two ticks."""

import hashlib

import numpy as np
import pytest
from case_changes import changed
from unit.twin.rig.test_engine import case, table_bytes

from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from schemas.sections.environment import Conditions
from schemas.wire.interventions import (
    FreeObject,
    MoveObject,
    PlaceEgo,
    RemoveObject,
    SetEnvironment,
    SpawnObject,
)
from twin.rig.engine import Engine
from twin.rig.interventions.slot_changes import SlotChanges
from twin.vehicle.state import COLUMN

SCENE = """
scene: mine
street: false
bake: false
obstacle: {x_m: 60}
terrain: {heightmap: flat.npy, size_m: [200, 100], position_m: [10, 0, 0]}
objects:
  - {kind: pedestrian, waypoints: [[20, 3], [20, -3]], speed_mps: 1.0}
  - {kind: car, waypoints: [[30, 8], [40, 8]], speed_mps: 5.0, present: moving, start_s: 30.0}
"""


def rich_case(name, weather="heavy_rain"):
    """Everything that remembers something from tick to tick."""
    data = {
        "campaign": "test",
        "seed": 4,
        "control_hz": 20,
        "camera": {
            "width": 32,
            "height": 18,
            "hz": 5,
            "effects": ["all"],
            "outputs": ["flow"],
        },
        "lidars": [{"name": "roof", "hz": 10}],
        "sensors": {
            "encoders": {"hz": 20},
            "gnss": {"hz": 10},
            "imu": {"hz": 20},
            "pose": {"hz": 10},
        },
        "scenario": {"ego_start_m": 60.0, "duration_s": 2.0},
        "matrix": {"weather": [weather], "time_of_day": ["12:00"]},
    }
    campaign, mistakes = parse_campaign(data)
    assert campaign is not None, mistakes
    return changed(expand(campaign)[0], id=name)


def drive(engine, slot):
    tick = int(engine.tick[slot])
    return Command(slot, 0, tick, 0.6, 0.0, 0.02 * np.sin(tick / 3))


def run(engine, cases, hold, act=lambda engine: None):
    """Run to the end; ``hold(engine, turn)``: slots to be held; ``act`` is called before every
    tick is sensed. Digests by case and tick."""
    for slot, one in cases.items():
        engine.reset(slot, one)
    names = {slot: one.id for slot, one in cases.items()}
    seen = {one.id: [] for one in cases.values()}
    done, held, turn = {}, set(), 0
    while len(done) < len(cases):
        wanted = hold(engine, turn) - {s for s, n in names.items() if n in done}
        turn += 1
        for slot in wanted - held:
            engine.hold(slot)
        for slot in held - wanted:
            engine.go_on(slot)
        held = wanted
        act(engine)
        sensed = engine.sense()
        for slot, name in names.items():
            if engine.active[slot]:
                parts = {n: d.values[slot].tobytes() for n, d in sorted(sensed.items())}
                seen[name].append(
                    (
                        int(engine.tick[slot]),
                        *(n + hashlib.sha256(p).hexdigest()[:8] for n, p in parts.items()),
                    )
                )
        commands = [drive(engine, s) if engine.active[s] else None for s in range(engine.slots)]
        for ended in engine.step(commands):
            done[names[ended.slot]] = table_bytes(ended.table)
    return done, seen


def test_a_slot_that_stands_still_changes_no_byte_of_itself_nor_of_others():
    one, two = rich_case("a"), rich_case("b", "clear")
    engine = Engine(one, 2)
    every = engine.refill_every
    assert every == 4
    plain = run(engine, {0: one, 1: two}, lambda engine, turn: set())
    assert {len(seen) for seen in plain[1].values()} == {40}

    # Held for two whole periods of the sensors, once between pictures; then the other one.
    def hold(engine, turn):
        return {0} if 6 <= turn < 6 + 2 * every else {1} if 21 <= turn < 21 + every else set()

    steered = run(engine, {0: one, 1: two}, hold)
    assert steered[1] == plain[1]
    assert steered[0] == plain[0]


def test_what_is_done_while_a_slot_stands_still_is_done_at_its_tick():
    one, two = rich_case("a"), rich_case("b", "clear")
    engine = Engine(one, 2)

    def at_tick_6(done):
        def act(engine):
            if not done and engine.tick[0] == 6:
                done.append(True)
                changes = SlotChanges(engine, "rig")
                changes.apply(0, SetEnvironment("heavy_snow", time_of_day_min=1200.0))
                changes.apply(0, PlaceEgo(x_m=150.0, y_m=0.5, yaw_rad=0.1, speed_mps=8.0))
                changes.apply(0, MoveObject(8, x_m=170.0, y_m=0.0, speed_mps=1.0))

        return act

    cases = {0: one, 1: two}
    untouched = run(engine, cases, lambda engine, turn: set())
    plain = run(engine, cases, lambda engine, turn: set(), at_tick_6([]))
    held = run(engine, cases, lambda engine, turn: {0} if 6 <= turn < 14 else set(), at_tick_6([]))
    assert held == plain
    assert plain[0]["a"] != untouched[0]["a"]
    assert (plain[0]["b"], plain[1]["b"]) == (untouched[0]["b"], untouched[1]["b"])


def test_a_held_case_can_be_cleared_and_its_slot_used_again(tmp_path):
    one = case("a")
    engine = Engine(one, 1)
    plain, _ = run(engine, {0: one}, lambda engine, turn: set())
    engine.reset(0, one)
    engine.sense()
    engine.step([drive(engine, 0)])
    engine.hold(0)
    assert not engine.active.any()
    engine.clear(0)
    again, _ = run(engine, {0: one}, lambda engine, turn: set())
    assert again == plain


def test_weather_time_and_place_are_those_of_the_hand():
    engine = Engine(case("a"), 2)
    changes = SlotChanges(engine, "rig")
    engine.reset(0, case("a"))
    engine.reset(1, case("b"))
    first = engine.sense()["environment"].values.copy()
    engine.step([drive(engine, 0), drive(engine, 1)])
    changes.apply(0, SetEnvironment(weather="heavy_fog", time_of_day_min=23 * 60.0))
    assert (changes.weather(0), changes.weather(1)) == ("heavy_fog", "clear")
    assert (changes.clock_min(0), changes.clock_min(1)) == (23 * 60.0, 12 * 60.0)
    changes.apply(0, PlaceEgo(x_m=7.0, y_m=1.0, yaw_rad=0.1, speed_mps=3.0))
    sensed = engine.sense()["environment"].values
    assert sensed[0, 0] < 0.1 * first[0, 0]
    assert sensed[0, 1] > 10 * first[0, 1]
    assert (sensed[1] == first[1]).all()
    row = engine.state[0]
    got = [row[COLUMN[name]] for name in ("x_m", "y_m", "yaw_rad", "speed_mps")]
    assert got == pytest.approx([7.0, 1.0, 0.1, 3.0])
    changes.apply(0, SetEnvironment(conditions=Conditions(rain=0.3)))
    assert changes.weather(0) == ""
    with pytest.raises(ValueError, match=r"weather 'fogg': allowed: clear"):
        changes.apply(0, SetEnvironment(weather="fogg"))
    assert changes.weather(0) == ""


def test_objects_move_come_and_go_by_hand(tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE)
    np.save(tmp_path / "flat.npy", np.zeros((11, 21)))
    one = case("a", scene=str(scene))
    engine = Engine(one, 2)
    changes = SlotChanges(engine, "rig")
    for slot in (0, 1):
        engine.reset(slot, one)
    engine.sense()
    walker, car = changes.objects(0)
    assert (walker.kind, walker.present, car.kind, car.present) == (
        "pedestrian",
        True,
        "car",
        False,
    )
    act = changes.apply
    assert act(0, SpawnObject("car", x_m=15.0, y_m=0.0, speed_mps=2.0)) == 1
    assert act(0, MoveObject(0, x_m=5.0, y_m=2.0)) == 0
    engine.sense()
    engine.step([drive(engine, 0), drive(engine, 1)])
    engine.sense()
    walker, car = changes.objects(0)
    assert (walker.x_m, walker.y_m, walker.by_hand) == (5.0, 2.0, True)
    assert (car.x_m, car.present) == (pytest.approx(15.1), True)
    assert not changes.objects(1)[1].present
    with pytest.raises(ValueError, match="no car to spare: all 1 of the scene are there"):
        act(0, SpawnObject("car", x_m=1.0, y_m=0.0))
    with pytest.raises(ValueError, match="given 'bus', the scene has car, pedestrian"):
        act(0, SpawnObject("bus", x_m=1.0, y_m=0.0))
    with pytest.raises(ValueError, match="given 2, the scene has 0 to 1"):
        act(0, RemoveObject(2))
    act(0, RemoveObject(1))
    act(0, FreeObject(0))
    act(0, MoveObject(0, x_m=1.0, y_m=1.0))
    act(0, FreeObject(0))
    engine.sense()
    walker, car = changes.objects(0)
    assert (walker.by_hand, car.present) == (False, False)
    act(0, RemoveObject(0))
    engine.clear(0)
    engine.reset(0, one)
    assert not any(each.by_hand for each in changes.objects(0))
