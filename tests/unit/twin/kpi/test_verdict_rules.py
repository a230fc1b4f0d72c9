"""What a jump scare asks, and which ends are a pass: the judge on drives of the real simulator."""

import numpy as np
import pytest
from unit.twin.rig.test_engine import ask, case, run

from twin.kpi import verdict as judging
from twin.kpi.recorder import CaseRows
from twin.kpi.table import DetectionColumn
from twin.rig.engine import Engine
from twin.road.lane import Piece, end_of, straight, trace
from twin.scenario import families
from twin.scenario.jump_scare.passing import past_from
from twin.scenario.surroundings import Surroundings
from twin.vehicle.state import COLUMN, TELEMETRY

NONE = DetectionColumn(np.zeros(1, np.int32), np.zeros(0, bool), [], *(np.zeros(0),) * 5)


def ended(policy, **scenario):
    one = case(**scenario)
    engine = Engine(one, 1)
    finished = run(engine, {0: one}, policy)["a"][0]
    engine.close()
    return finished


def crawl(engine, slot):
    slow = engine.state[slot, COLUMN["speed_mps"]] < 0.5
    return ask(engine, slot, throttle=0.3 if slow else 0.0, brake=0.0 if slow else 0.2)


def roll(engine, slot):
    return ask(engine, slot)


def hold(engine, slot):
    return ask(engine, slot, brake=1.0)


def swerve(engine, slot):
    """Round the obstacle on the left, and back towards the lane."""
    at_m = engine.state[slot, COLUMN["x_m"]] - engine.world.obstacle_rear_m
    return ask(engine, slot, steering=0.09 if at_m < -19.0 else -0.09 if at_m < -9.0 else 0.0)


def test_a_stack_that_crawls_until_time_is_up_has_not_passed():
    finished = ended(crawl, ego_start_m=20.0, duration_s=4.0)
    assert 0.0 < finished.table.columns["speed_mps"].values[-1] < 1.0
    assert (finished.verdict, finished.passed) == ("time_up", False)
    assert "neither stopped for it nor gone round it" in finished.reasons[0]


def test_full_speed_six_metres_before_the_obstacle_when_time_runs_out_is_no_pass():
    finished = ended(roll, ego_start_m=20.0, ego_speed_mps=7.8, duration_s=1.8)
    assert 5.0 < finished.scalars["dtc_end_m"] < 7.0
    assert finished.table.columns["speed_mps"].values[-1] > 7.5
    assert (finished.verdict, finished.passed) == ("time_up", False)


@pytest.mark.parametrize(("start_m", "verdict"), [(60.0, "false_braking"), (20.0, "time_up")])
def test_a_stack_that_never_moves_has_not_passed(start_m, verdict):
    finished = ended(hold, ego_start_m=start_m, duration_s=1.0)
    assert (finished.verdict, finished.passed) == (verdict, False)
    assert "never moved" in finished.reasons[0]


@pytest.mark.parametrize(("start_m", "verdict"), [(60.0, "false_braking"), (20.0, "pass")])
def test_a_rest_passes_near_the_obstacle_only(start_m, verdict):
    finished = ended(hold, ego_start_m=start_m, ego_speed_mps=3.0, standstill_s=0.5, duration_s=9.0)
    assert (finished.verdict, finished.passed) == (verdict, verdict == "pass")
    assert finished.reasons[0].startswith("came to rest")


def test_who_goes_round_the_obstacle_passes_and_the_reason_says_so(clear_road):
    finished = ended(swerve, scene=clear_road, ego_start_m=25.0, ego_speed_mps=8.0, duration_s=6.0)
    assert finished.scalars["collisions"] == 0, finished.reasons
    assert (finished.verdict, finished.passed) == ("pass", True)
    assert finished.reasons[0].startswith("went round the obstacle without touching it")


def test_a_hull_beside_the_obstacle_is_not_past_it(clear_road):
    finished = ended(swerve, scene=clear_road, ego_start_m=25.0, ego_speed_mps=8.0, duration_s=3.6)
    assert finished.scalars["dtc_end_m"] < 2.0
    assert finished.verdict == "time_up", finished.reasons


@pytest.fixture(scope="module")
def clear_road(tmp_path_factory):
    """Nothing at the kerbs."""
    path = tmp_path_factory.mktemp("scene") / "clear.yaml"
    path.write_text(
        "scene: clear\nobstacle: {x_m: 190.0}\nbake: false\n"
        "furniture: {parked_cars: 0.0, tree_spacing_m: 100, lamp_spacing_m: 100}\n"
    )
    return str(path)


def rows_of(speed, x, dtc=None):
    count = len(speed)
    values = {
        "tick": np.arange(count, dtype=np.int32),
        "sim_time_ns": np.arange(count) * 50_000_000,
        "x_m": np.array(x, float),
        "y_m": np.zeros(count),
        "yaw_rad": np.zeros(count),
        "speed_mps": np.array(speed, float),
        "dtc_m": np.zeros(count) if dtc is None else np.array(dtc, float),
    }
    return CaseRows(values, {}, np.array([""]), NONE)


def judged(rows, course, *, moved=True):
    state = np.zeros(len(TELEMETRY))
    state[COLUMN["moved"]] = moved
    run = families.replay(case().variation.scenario, course, rows)
    return judging.judge(rows, state, run, None)


ROAD = Surroundings(straight(0.0, 100.0), np.array([50.0, 0.0, 0.0, 2.0, 0.9]), 1.4, 2.4, 0.9)
FREE = Surroundings(straight(0.0, 100.0), None, 1.4, 2.4, 0.9)


@pytest.mark.parametrize(
    ("x_end_m", "verdict"),
    # Its rear bumper is 1 m behind the reference point, the obstacle's front at 52 m.
    [(53.0, "time_up"), (53.001, "pass")],
)
def test_the_whole_hull_must_be_past_the_obstacle(x_end_m, verdict):
    found = judged(rows_of([5.0] * 4, [20.0, 30.0, 45.0, x_end_m]), ROAD)
    assert found.verdict == verdict


def test_a_rest_beyond_the_obstacle_comes_after_the_question_and_one_before_it_does_not():
    x = [20.0, 30.0, 54.0, 90.0, 90.0]
    after = judged(rows_of([5, 5, 5, 5, 0], x, [30, 20, 2, 38, 38]), ROAD)
    assert after.verdict == "pass"
    assert "went round" in after.reasons[0]
    before = judged(rows_of([5, 0, 5, 5, 5], x, [40, 31, 2, 38, 38]), ROAD)
    assert before.verdict == "false_braking"


def test_a_start_beyond_the_obstacle_went_round_nothing():
    """A co-simulated car may be put anywhere by its first pose."""
    assert judged(rows_of([5.0] * 4, [20.0, 60.0, 70.0, 80.0]), ROAD).verdict == "time_up"


def test_on_a_closed_road_the_lap_counts():
    """The obstacle stands just behind the start: it is ahead by nearly a lap."""
    pieces = [Piece(100.0, 0.0), Piece(62.83185307, 0.05), Piece(100.0, 0.0)]
    pieces.append(Piece(62.83185307, 0.05))
    lane = trace((0.0, 0.0, 0.0), pieces, closed=True)
    assert np.allclose(end_of((0.0, 0.0, 0.0), pieces)[:2], 0.0, atol=1e-6)
    course = Surroundings(lane, np.array([20.0, 0.0, 0.0, 2.0, 0.9]), 1.4, 2.4, 0.9)
    stations = np.arange(40.0, 40.0 + 320.0, 4.0)
    pose = lane.at(stations)
    rows = rows_of([5.0] * len(stations), pose.x_m)
    rows.column("y_m")[:] = pose.y_m
    rows.column("yaw_rad")[:] = pose.yaw_rad
    past = past_from(course, rows)
    assert past is not None
    # The rear bumper is 1 m behind the reference point, the obstacle's front at 22 m of lap two.
    assert stations[past - 1] - 1.0 <= lane.length_m + 22.0 < stations[past] - 1.0


def test_moving_backwards_is_moving_and_standing_before_it_is_no_rest():
    found = judged(rows_of([0, 0, -1, -2], [20, 20, 19, 18], [40, 40, 41, 42]), ROAD)
    assert found.verdict == "time_up"


@pytest.mark.parametrize(
    ("speed", "moved", "verdict"),
    [
        ([0, 2, 4, 4], True, "pass"),
        ([0, 2, 0, 4], True, "false_braking"),
        ([0, 2, 4, 0], True, "false_braking"),
        ([0, 0, 0, 0], False, "false_braking"),
    ],
)
def test_without_an_obstacle_nothing_is_a_reason_to_stop(speed, moved, verdict):
    found = judged(rows_of(speed, [20.0, 21.0, 22.0, 23.0]), FREE, moved=moved)
    assert found.verdict == verdict
    assert "nothing stood in its way" in found.reasons[0]
    assert "obstacle" not in found.reasons[0]
