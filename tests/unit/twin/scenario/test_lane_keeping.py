"""Lane keeping in the engine: where the ego starts, what is measured, how a case ends."""

from __future__ import annotations

import math

import numpy as np
import pytest
from case_changes import changed

from devkit.aeb import AebStack
from devkit.stack import Observation
from schemas.messages import Command, Episode
from schemas.plan import expand, parse_campaign
from schemas.wire.interventions import PlaceEgo
from twin.rig.engine import Engine
from twin.road.lane import Piece, straight, trace
from twin.scenario.lane_keeping.progress import LaneProgress
from twin.vehicle.state import COLUMN

LANE_SCALARS = ("distance_m", "lateral_error_rms_m", "lateral_error_max_m")


def case(name="a", camera=None, stack=None, **scenario):
    scenario = {
        "type": "lane_keeping",
        "ego_speed_mps": 8.0,
        "duration_s": 10.0,
        "distance_m": 20.0,
        **scenario,
    }
    data = {
        "campaign": "test",
        "camera": {"width": 32, "height": 18, "hz": 10, "reflections": False, **(camera or {})},
        "scenario": scenario,
        "matrix": {"weather": ["clear"]},
    }
    campaign, mistakes = parse_campaign(data)
    assert campaign is not None, mistakes
    return changed(expand(campaign)[0], id=name)


def run(one, policy, engine=None):
    engine = engine or Engine(one, 1)
    engine.reset(0, one)
    while True:
        engine.sense()
        asked = policy(engine)
        command = Command(0, 0, int(engine.tick[0]), *asked)
        for ended in engine.step([command]):
            return ended


def test_starts_on_the_lane_and_passes_at_the_end_of_the_distance():
    one = case()
    ended = run(one, lambda _: (0.15, 0.0, 0.0))
    assert (ended.verdict, ended.passed) == ("pass", True)
    columns, scalars = ended.table.columns, ended.scalars
    assert (columns["x_m"].values[0], columns["y_m"].values[0]) == (-65.0, 0.0)
    assert 20.0 <= scalars["distance_m"] < 20.5
    assert scalars["distance_m"] == pytest.approx(columns["x_m"].values[-1] + 65.0, abs=1e-6)
    error = columns["lateral_error_m"]
    assert error.valid.all()
    assert error.values == pytest.approx(columns["y_m"].values, abs=1e-6)
    assert scalars["lateral_error_max_m"] == np.abs(error.values).max()
    rms_m = math.sqrt(float((error.values**2).mean()))
    assert scalars["lateral_error_rms_m"] == pytest.approx(rms_m)
    assert f"{rms_m:.3f} m RMS" in ended.reasons[0]


def test_out_of_the_lane_ends_the_case():
    one = case(lateral_limit_m=0.3, distance_m=100.0)
    ended = run(one, lambda _: (0.15, 0.0, -0.05))
    assert (ended.verdict, ended.passed) == ("lane_departure", False)
    error = ended.table.columns["lateral_error_m"].values
    assert error[-1] < -0.3 <= error[-2]
    assert "right of the lane's centre" in ended.reasons[0]
    assert "allowed: 0.3 m" in ended.reasons[0]
    assert ended.scalars["distance_m"] < 100.0


def test_too_far_from_the_middle_for_too_long_is_a_departure_at_the_end():
    one = case(lateral_rms_limit_m=0.01)
    ended = run(one, lambda e: (0.15, 0.0, 0.02 if e.tick[0] < 10 else -0.005))
    assert (ended.verdict, ended.passed) == ("lane_departure", False)
    assert ended.scalars["distance_m"] >= 20.0
    assert ended.scalars["lateral_error_max_m"] < 0.75
    assert "allowed: 0.01 m" in ended.reasons[0]


def test_a_stop_on_the_free_lane_is_false_braking():
    one = case(standstill_s=0.5, ego_speed_mps=3.0)
    ended = run(one, lambda _: (0.0, 1.0, 0.0))
    assert (ended.verdict, ended.passed) == ("false_braking", False)
    assert "came to rest" in ended.reasons[0]


@pytest.mark.parametrize("speed_mps", [0.0, 8.0])
def test_time_up_is_no_pass(speed_mps):
    ended = run(case(duration_s=1.0, ego_speed_mps=speed_mps), lambda _: (0.0, 0.0, 0.0))
    assert (ended.verdict, ended.passed) == ("time_up", False)
    assert ended.scalars["sim_time_s"] == 1.0
    assert ended.scalars["distance_m"] < 20.0


def test_a_parked_car_is_a_collision():
    ended = run(
        case(distance_m=200.0, lateral_limit_m=10.0, ego_speed_mps=15.0),
        lambda _: (0.3, 0.0, -0.01),
    )
    assert (ended.verdict, ended.passed) == ("collision", False)


@pytest.mark.parametrize(
    ("distance_m", "said"),
    [
        (411.0, "lane_keeping over 411 m, but its lane is 410 m long; set scenario.distance_m"),
        (410.0, "the broken-down car stands in the lane; set obstacle.y_m"),
        (293.5, "the broken-down car stands in the lane; set obstacle.y_m"),
    ],
)
def test_a_lane_that_is_too_short_or_not_free_is_refused(distance_m, said):
    """``downtown``: 410 m long, the broken-down car from 297 m on, the ego 4 m before its axle."""
    one = case(distance_m=distance_m)
    with pytest.raises(ValueError, match=r"scene downtown: lane_keeping") as error:
        Engine(one, 1).reset(0, one)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_the_lane_up_to_the_broken_down_car_is_free():
    one = case(distance_m=292.5)
    Engine(one, 1).reset(0, one)


def test_without_a_street_there_is_no_lane(tmp_path):
    path = tmp_path / "bare.yaml"
    np.save(tmp_path / "flat.npy", np.zeros((8, 8)))
    path.write_text(
        "schema: 1\nscene: bare\nstreet: false\nbake: false\nobstacle: {x_m: 60}\n"
        "terrain: {heightmap: flat.npy, size_m: [400, 400], semantic: road}\n"
    )
    one = case(scene=str(path))
    with pytest.raises(ValueError, match="lane_keeping needs a lane: a generated street or"):
        Engine(one, 1).reset(0, one)


def test_a_jump_scare_has_no_lateral_error():
    data = {
        "campaign": "t",
        "camera": {"width": 32, "height": 18, "hz": 10},
        "matrix": {"repeat": [0]},
    }
    data["scenario"] = {"duration_s": 0.2}
    campaign, mistakes = parse_campaign(data)
    assert campaign is not None, mistakes
    ended = run(expand(campaign)[0], lambda _: (0.0, 0.0, 0.0))
    assert not ended.table.columns["lateral_error_m"].valid.any()
    assert [ended.scalars[name] for name in LANE_SCALARS] == [None, None, None]


def test_laps_add_up_and_ways_back_count_less():
    quarter = Piece(math.pi / 2 * 20.0, 1 / 20.0)
    lane = trace((0.0, 0.0, 0.0), [Piece(30.0, 0.0), quarter] * 4, closed=True)
    progress = LaneProgress(lane, 0.0, 0.3)
    for step in range(1, 61):
        pose = lane.at(step * lane.length_m / 30.0, -0.2)
        progress.move(float(pose.x_m), float(pose.y_m))
        assert progress.lateral_m == pytest.approx(-0.2, abs=1e-6)
    assert progress.distance_m == pytest.approx(2 * lane.length_m, abs=1e-6)
    pose = lane.at(-5.0)
    progress.move(float(pose.x_m), float(pose.y_m))
    assert progress.distance_m == pytest.approx(2 * lane.length_m - 5.0, abs=1e-6)
    along = LaneProgress(straight(0.0, 100.0), 40.0, 0.0)
    along.move(130.0, 1.0)
    assert (along.distance_m, along.lateral_m) == (90.0, 1.0)


def test_many_egos_are_placed_at_once_to_the_bits_of_one_at_a_time():
    loop = trace(
        (3.0, -7.0, 0.4),
        [Piece(60.0, 0.0), Piece(50.0 * math.pi, 1 / 50), Piece(60.0, 0.0), Piece(157.08, 0.02)],
        closed=True,
    )
    lanes = [loop, straight(-5.0, 400.0)]
    random = np.random.default_rng(4)
    starts = random.uniform(-40.0, 120.0, (2, 37))
    together, alone = (
        [LaneProgress(lanes[n % 2], x, y) for n, (x, y) in enumerate(starts.T)] for _ in range(2)
    )
    for _ in range(50):
        starts += random.normal(0.3, 0.4, starts.shape)
        LaneProgress.move_together(together, *starts)
        for ego, x, y in zip(alone, *starts, strict=True):
            ego.move(x, y)
    for one, other in zip(together, alone, strict=True):
        assert (one.distance_m, one.lateral_m) == (other.distance_m, other.lateral_m)
    LaneProgress.move_together([], *np.zeros((2, 0)))


@pytest.mark.slow
def test_the_stack_follows_a_narrow_bend_of_the_loop_by_its_camera():
    """Into and out of the arc of 25 m radius, left, at 8 m/s."""
    one = case(camera={"width": 320, "height": 180}, scene="downtown-loop", distance_m=58.0)
    engine = Engine(one, 1)
    engine.reset(0, one)
    lane = engine._world.lane
    pose = lane.at(368.0)
    x_m, y_m, yaw_rad = (float(value) for value in (pose.x_m, pose.y_m, pose.yaw_rad))
    engine.place_ego(0, PlaceEgo(x_m, y_m, yaw_rad, 8.0))
    stack = AebStack(1, steering="visual", ttc_max_s=1.5)
    camera = one.rig.camera
    stack.reset(
        0,
        Episode(
            v=1,
            seq=0,
            slot=0,
            token=0,
            case="a",
            seed=0,
            model="default",
            perception=one.variation.perception,
            camera=camera.name,
            width=camera.width,
            height=camera.height,
            hfov_deg=camera.hfov_deg,
            control_period_ns=engine.control_period_ns,
            cameras=engine.camera_sites,
        ),
    )
    finished, seq = [], 0
    while not finished:
        sensors = engine.sense()
        seen = Observation(
            seq,
            engine.active,
            np.zeros(1, np.int64),
            engine.tick,
            engine.sim_time_ns,
            {name: data.values for name, data in sensors.items()},
            {name: data.count for name, data in sensors.items() if data.count is not None},
        )
        finished = engine.step(list(stack.step(seen)))
        seq += 1
    ended = finished[0]
    assert ended.verdict == "pass", ended.reasons
    assert ended.scalars["lateral_error_rms_m"] < 0.12
    assert ended.scalars["lateral_error_max_m"] < 0.25
    turned = np.ptp(np.unwrap(ended.table.columns["yaw_rad"].values))
    assert turned > 1.4
    assert not (ended.table.columns["aeb"].values & ended.table.columns["aeb"].valid).any()
    assert COLUMN["yaw_rad"] == 2
