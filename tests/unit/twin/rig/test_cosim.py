"""Cars that the stack moves itself: what is recorded, hit, sensed and refused."""

import math

import msgspec
import numpy as np
import pytest
from case_changes import changed
from unit.twin.rig.test_engine import ask, brake_late, case, run, table_bytes

from schemas.messages import IMU_COLUMNS, Pose
from schemas.sections.sensors import Sensors
from twin.rig.engine import CARRIED, Engine
from twin.vehicle.carry import SPEED_MAX_MPS

PERIOD_S = 0.05


def cosim(name="a", **scenario):
    return changed(case(name, standstill_s=0.3, **scenario), cosim=True)


def pose(x_m, y_m=0.0, yaw_rad=0.0, z_m=0.0):
    return Pose(x_m, y_m, z_m, 0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2))


def curve(start_x_m, start_y_m):
    """Poses by tick: 4 m/s around a bend, then rest."""

    def at(tick):
        along = 4.0 * PERIOD_S * min(tick, 20)
        turned = along / 30.0
        return pose(
            start_x_m + 30.0 * math.sin(turned),
            start_y_m + 30.0 * (1.0 - math.cos(turned)),
            turned,
        )

    return at


def driver(way):
    return lambda engine, slot: ask(engine, slot, 0.7, 0.2, pose=way(int(engine.tick[slot]) + 1))


@pytest.fixture(scope="module")
def engine():
    return Engine(cosim(), 2)


def start_of(engine, given=None):
    """Where the scenario puts the car."""
    engine.reset(0, given or cosim())
    x_m, y_m = (float(value) for value in engine.state[0, :2])
    engine.clear(0)
    return x_m, y_m


def test_positions_are_those_sent_and_motion_follows_from_them(engine):
    way = curve(*start_of(engine))
    done = run(engine, {1: cosim("a", duration_s=3.0)}, driver(way))
    ended = done["a"][0]
    assert (ended.outcome, ended.verdict) == ("verdict", "false_braking")
    assert ended.reasons[-1] == CARRIED
    rows = ended.table.columns
    ticks = rows["tick"].values
    sent = [way(tick) for tick in ticks]
    for name, wanted in (
        ("x_m", [p.x_m for p in sent]),
        ("y_m", [p.y_m for p in sent]),
        ("yaw_rad", [2 * math.atan2(p.qz, p.qw) for p in sent]),
    ):
        assert np.abs(rows[name].values - wanted).max() < 1e-9
    speed = rows["speed_mps"].values
    assert speed[2:21] == pytest.approx(4.0, abs=0.1)
    assert speed[21:].tolist() == [0.0] * (len(ticks) - 21)
    # At rest 20 periods after the start, and over standstill_s later; pedals did nothing.
    assert ticks[-1] == pytest.approx(21 + 0.3 / PERIOD_S, abs=1)
    assert rows["throttle"].values[3] == 0.7
    assert rows["accel_mps2"].values[1] == pytest.approx(4.0 / PERIOD_S, rel=0.05)


def test_the_cars_own_sensors_feel_it():
    sensing = changed(
        cosim(),
        sensors=msgspec.convert({"imu": {"noise": False}, "encoders": {}, "pose": {}}, Sensors),
    )
    engine = Engine(sensing, 1)
    way = curve(*start_of(engine, sensing))
    engine.reset(0, sensing)
    for tick in range(12):
        sensed = engine.sense()
        engine.step([ask(engine, 0, pose=way(tick + 1))])
    imu = dict(zip(IMU_COLUMNS, sensed["imu"].values[0], strict=True))
    assert imu["rate_z_radps"] == pytest.approx(4.0 / 30.0, rel=0.01)
    # Where the IMU sits, across the bend: v^2 / r.
    assert imu["accel_y_mps2"] == pytest.approx(4.0**2 / 30.0, rel=0.1)
    assert imu["accel_z_mps2"] == pytest.approx(9.80665, abs=0.01)
    assert sensed["pose"].values[0][0] == pytest.approx(way(11).x_m, abs=1e-9)
    turned = sensed["encoders"].values[0][2]
    assert turned == pytest.approx(44 * 4.0 * 11 * PERIOD_S / (2 * math.pi * 0.36), rel=0.15)
    engine.close()


def test_what_stands_in_the_way_is_hit_also_between_two_poses(engine):
    x_m, y_m = start_of(engine)

    def way(tick):
        return pose(x_m + 7.3 * tick, y_m)  # 146 m/s: the obstacle's hull is 4 m long

    ended = run(engine, {0: cosim("a")}, driver(way))["a"][0]
    assert ended.verdict == "collision"
    assert ended.scalars["impact_speed_mps"] == pytest.approx(146.0)
    assert ended.scalars["dtc_end_m"] < 0.3
    assert ended.reasons[-1] == CARRIED


def test_the_first_pose_may_be_anywhere_and_the_next_may_not(engine):
    x_m, y_m = start_of(engine)
    reach_m = SPEED_MAX_MPS * PERIOD_S

    def jump(tick):
        return pose(x_m - 40.0, y_m) if tick < 4 else pose(x_m - 40.0 + reach_m + 0.1, y_m)

    ended = run(engine, {0: cosim("a")}, driver(jump))["a"][0]
    assert ended.outcome == "failed"
    assert ended.reasons[0] == (
        "command pose is 7.6 m from the last one, allowed: 7.5 m in a control period (150 m/s), "
        "at tick 3"
    )
    rows = ended.table.columns
    assert rows["x_m"].values[1:] == pytest.approx(x_m - 40.0)
    assert rows["speed_mps"].values.tolist() == [0.0] * 4


@pytest.mark.parametrize(
    ("sent", "words"),
    [
        (pose(math.nan), "command pose.x_m is nan, allowed: +-100000"),
        (Pose(0, 0, 1e6, 0, 0, 0, 1), "command pose.z_m is 1000000.0, allowed"),
        (Pose(0, 0, 0, 0, 0, 0, 0), "command pose: the quaternion's length is 0, allowed: 1"),
        (Pose(0, 0, 0, 0, 0, math.nan, 1), "command pose: the quaternion's length is nan"),
    ],
)
def test_a_pose_that_is_none_ends_the_case(engine, sent, words):
    ended = run(engine, {0: cosim("a")}, driver(lambda tick: sent))["a"][0]
    assert ended.outcome == "failed"
    assert ended.reasons[0].startswith(words)


def test_poses_are_refused_where_the_campaign_does_not_say_so(engine):
    plain = changed(cosim("a"), cosim=False)
    ended = run(engine, {0: plain}, driver(lambda tick: pose(0.0)))["a"][0]
    assert ended.outcome == "failed"
    assert ended.reasons == ["command pose is given, but autonomy.cosim is off, at tick 0"]


def test_a_car_that_is_given_back_rolls_on(engine):
    x_m, y_m = start_of(engine)

    def policy(engine, slot):
        tick = int(engine.tick[slot])
        if tick < 10:
            return ask(engine, slot, pose=pose(x_m + 5.0 * PERIOD_S * (tick + 1), y_m))
        return ask(engine, slot)

    ended = run(engine, {0: cosim("a", duration_s=1.0)}, policy)["a"][0]
    speed = ended.table.columns["speed_mps"].values
    assert speed[5:11] == pytest.approx(5.0, abs=1e-6)
    assert 3.5 < speed[-1] < 5.0
    assert np.diff(speed[10:]).max() < 0.05


def test_neighbours_and_slots_see_nothing_of_it(engine):
    way = curve(*start_of(engine))

    def both(engine, slot):
        return driver(way)(engine, slot) if slot == carried else brake_late(engine, slot)

    found = set()
    for carried in (0, 1):
        cases = {carried: cosim("a"), 1 - carried: case("b")}
        done = run(engine, cases, both)
        found.add(tuple((table_bytes(done[n][0].table), b"".join(done[n][1])) for n in "ab"))
    assert len(found) == 1
    carried = -1
    (alone,) = run(engine, {0: case("b")}, brake_late).values()
    assert (table_bytes(alone[0].table), b"".join(alone[1])) == next(iter(found))[1]
