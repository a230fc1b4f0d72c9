"""The car's own sensors in the engine: rates, refills, changes at run time, and none at all."""

import math

import msgspec
import numpy as np
import pytest
from case_changes import changed
from sensor_rows import case as bare_case

from schemas.messages import (
    ENCODER_COLUMNS,
    GNSS_COLUMNS,
    VEHICLE_COLUMNS,
    Command,
    SensorErrors,
)
from twin.rig.engine import Engine
from twin.vehicle.state import COLUMN, columns

ALL = {"gnss": {}, "imu": {}, "encoders": {}}
FIX = GNSS_COLUMNS.index("fix")


def case(name="a", speed_mps=8.0, **sensors):
    one = bare_case(name, **sensors)
    scenario = msgspec.structs.replace(
        one.variation.scenario, ego_start_m=60.0, ego_speed_mps=speed_mps, duration_s=2.0
    )
    return changed(one, scenario=scenario)


def command(engine, slot, steering_rad=0.0, throttle=0.3, **more):
    return Command(slot, 0, int(engine.tick[slot]), throttle, 0.0, steering_rad, **more)


def drive(engine, slots, ticks, changes=None):
    """Sensor bytes per slot and tick; ``changes``: tick -> errors of slot 0 of ``slots``."""
    seen = {slot: [] for slot in slots}
    for tick in range(ticks):
        sensors = engine.sense()
        for slot in slots:
            own = {n: d.values[slot].tobytes() for n, d in sensors.items() if n in ALL}
            seen[slot].append(own)
        commands = [None] * engine.slots
        for slot in slots:
            errors = (changes or {}).get(tick) if slot == slots[0] else None
            commands[slot] = command(engine, slot, 0.02 * math.sin(0.3 * tick), sensors=errors)
        engine.step(commands)
    return seen


def test_nothing_is_there_unless_asked_for():
    engine = Engine(case(), 1)
    engine.reset(0, case())
    assert set(engine.sense()) == {"camera", "boxes", "vehicle", "environment"}
    assert engine.refill_every == case().rig.control_hz // case().rig.camera.hz
    assert engine._truth is None


def test_each_sensor_comes_at_its_own_rate():
    one = case(gnss={"hz": 5}, imu={}, encoders={"hz": 10})
    engine = Engine(one, 1)
    engine.reset(0, one)
    seen = drive(engine, [0], 13)[0]
    for tick, own in enumerate(seen):
        assert ("gnss" in own) == (tick % 4 == 0)
        assert ("encoders" in own) == (tick % 2 == 0)
        assert "imu" in own
    assert engine.refill_every == 4
    mixed = case(gnss={"hz": 4}, encoders={"hz": 10})
    assert Engine(mixed, 1).refill_every == math.lcm(5, 2, 1)


def test_slots_that_are_not_due_together_are_our_own_mistake():
    one = case(gnss={"hz": 5})
    engine = Engine(one, 2)
    engine.reset(0, one)
    drive(engine, [0], 2)
    engine.reset(1, one)
    with pytest.raises(AssertionError, match="due for their sensors together"):
        engine.sense()


def test_sensors_do_not_depend_on_slot_or_neighbours():
    first, second = case("a", **ALL), case("b", speed_mps=3.0, **ALL)
    alone = {}
    for one in (first, second):
        engine = Engine(one, 1)
        engine.reset(0, one)
        alone[one.id] = drive(engine, [0], 30)[0]
    engine = Engine(first, 5)
    for slot, one in ((4, first), (1, second)):
        engine.reset(slot, one)
    together = drive(engine, [4, 1], 30)
    assert together == {4: alone["a"], 1: alone["b"]}
    assert alone["a"] != alone["b"]


def test_a_slot_that_was_cleared_reads_zero():
    one = case("a", **ALL)
    engine = Engine(one, 2)
    engine.reset(0, one)
    engine.reset(1, one)
    drive(engine, [0, 1], 2)
    engine.clear(0)
    sensors = engine.sense()
    for name in ALL:
        assert not sensors[name].values[0].any(), name
        assert sensors[name].values[1].any(), name


def test_errors_differ_by_slot_of_one_rig():
    quiet = case("a", gnss={"noise": False}, imu={"noise": False})
    noisy = case("a", gnss={}, imu={})
    engine = Engine(quiet, 2)
    engine.reset(0, quiet)
    engine.reset(1, noisy)
    sensors = engine.sense()
    assert sensors["imu"].values[0] == pytest.approx([0, 0, 9.80665, 0, 0, 0], abs=1e-9)
    assert (sensors["imu"].values[1] != sensors["imu"].values[0]).all()
    assert (sensors["gnss"].values[0] != sensors["gnss"].values[1])[:3].all()


def test_seed_and_case_decide_the_errors():
    def first(one):
        engine = Engine(one, 1)
        engine.reset(0, one)
        return engine.sense()["imu"].values[0].copy()

    base = case("a", imu={})
    assert (first(base) == first(base)).all()
    assert (first(base) != first(case("b", imu={}))).all()
    assert (first(base) != first(changed(base, seed=5))).all()


def test_sensors_follow_the_vehicle():
    one = case(gnss={"noise": False}, imu={"noise": False}, encoders={"ppr": 1000})
    engine = Engine(one, 1)
    engine.reset(0, one)
    start = engine.sense()["gnss"].values[0].copy()
    x_m = engine.state[0, COLUMN["x_m"]]
    for _ in range(20):
        engine.step([command(engine, 0)])
        sensors = engine.sense()
    way_m = engine.state[0, COLUMN["x_m"]] - x_m
    turned = engine.state[0, columns("wheel_angle")] / (2 * math.pi)
    radius_m = 6371e3 * math.cos(math.radians(start[0]))
    east_m = math.radians(sensors["gnss"].values[0, 1] - start[1]) * radius_m
    assert east_m == pytest.approx(way_m, rel=0.005)
    ticks = sensors["encoders"].values[0]
    assert ticks.tolist() == np.floor(1000 * turned).tolist()
    assert turned == pytest.approx([way_m / (2 * math.pi * 0.36)] * 4, rel=0.02)
    force = engine.state[0, columns("specific_force")]
    assert sensors["imu"].values[0, :3].tolist() == force.tolist()
    assert len(ticks) == len(ENCODER_COLUMNS)


def test_a_stack_changes_errors_from_the_next_tick_on():
    one = case(gnss={"hz": 20}, imu={})
    engine = Engine(one, 2)
    engine.reset(0, one)
    engine.reset(1, one)
    changes = {5: SensorErrors(gnss_dropout=True, imu_noise=0.0, imu_bias=0.0), 9: SensorErrors()}
    seen = drive(engine, [0, 1], 14, changes)
    for tick in range(14):
        changed = 6 <= tick <= 9
        assert (seen[0][tick] != seen[1][tick]) == changed, tick
        fix = np.frombuffer(seen[0][tick]["gnss"])[FIX]
        assert fix == (0.0 if changed else 1.0)


@pytest.mark.parametrize(
    ("sensors", "errors", "words"),
    [
        ({"gnss": {}}, SensorErrors(gnss_noise=-1.0), "sensors.gnss_noise is -1.0, allowed: 0 to"),
        ({"gnss": {}}, SensorErrors(gnss_bias=math.nan), "sensors.gnss_bias is nan, allowed: 0"),
        ({"imu": {}}, SensorErrors(imu_bias=1e6), "sensors.imu_bias is 1000000.0, allowed: 0 to"),
        ({"imu": {}}, SensorErrors(gnss_dropout=True), "the campaign has no sensors.gnss"),
        ({}, SensorErrors(imu_noise=2.0), "the campaign has no sensors.imu"),
    ],
)
def test_a_bad_change_fails_its_slot_only(sensors, errors, words):
    one = case(**sensors)
    engine = Engine(one, 2)
    engine.reset(0, one)
    engine.reset(1, one)
    ended = engine.step([command(engine, 0, sensors=errors), command(engine, 1)])
    assert [(e.slot, e.outcome) for e in ended] == [(0, "failed")]
    assert words in ended[0].reasons[0]
    assert engine.active.tolist() == [False, True]


def test_by_wire_feedback_lags_and_has_a_handbrake_column():
    one = case()
    engine = Engine(one, 1)
    engine.reset(0, one)
    engine.step([command(engine, 0, steering_rad=0.1, throttle=1.0)])
    values = dict(zip(VEHICLE_COLUMNS, engine.sense()["vehicle"].values[0], strict=True))
    assert 0.0 < values["throttle"] < 1.0
    assert 0.0 < values["steering_rad"] < 0.1
    assert values["handbrake"] == 0.0
