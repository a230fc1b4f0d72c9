"""The judge on made-up rows: every end of lane keeping, collisions, and what was hit."""

import numpy as np
import pytest

from schemas.campaign import Scenario
from twin.kpi.recorder import KpiRecorder
from twin.kpi.verdict import judge, names, scalars
from twin.road.lane import straight
from twin.scenario import families
from twin.scenario.surroundings import Surroundings
from twin.vehicle.state import COLUMN
from twin.world.things import Thing

SCENARIO = Scenario(type="lane_keeping", distance_m=100.0)
GROUND = Surroundings(straight(0.0, 500.0), None, 1.4, 2.4, 0.9)
VAN = Thing("van", "car", hull=2, hulls=3)


def lane(distance_m, lateral_m=0.1):
    """A case of lane keeping that has come so far."""
    run = families.begin(SCENARIO, GROUND, 0.0, 0.0)
    run.progress.distance_m, run.progress.lateral_m = distance_m, lateral_m
    return run


def rows(speeds, error_m=0.1):
    """Rows of one case and its last state."""
    recorder, state = KpiRecorder(1), np.zeros((1, len(COLUMN)))
    for tick, speed in enumerate(speeds):
        state[0, COLUMN["speed_mps"]] = speed
        now = np.array([tick])
        recorder.add([0], now, now * 50_000_000, state, [None], [{"lateral_error_m": error_m}])
    return recorder.of(0), state[0]


def kept(way, speeds=(5.0, 8.0), error_m=0.1):
    found, state = rows(speeds, error_m)
    result = judge(found, state, way, None)
    (reason,) = result.reasons
    return result.verdict, reason


@pytest.mark.parametrize(
    ("lateral_m", "error_m", "verdict", "reason"),
    [
        (0.76, 0.1, "lane_departure", "0.76 m left of the lane's centre"),
        (-0.76, 0.1, "lane_departure", "0.76 m right of the lane's centre"),
        (0.75, 0.1, "time_up", "time is up at 8.00 m/s"),
        (0.1, 0.26, "lane_departure", "lateral error 0.260 m RMS"),
        (0.1, -0.25, "time_up", "time is up at 8.00 m/s"),
    ],
)
def test_limits_of_a_lane_are_exact(lateral_m, error_m, verdict, reason):
    found, words = kept(lane(50.0, lateral_m), error_m=error_m)
    assert found == verdict
    assert words.startswith(reason)
    assert "after 50.0 m of 100 m" in words


def test_the_whole_way_in_the_lane_is_a_pass():
    assert kept(lane(100.0)) == ("pass", "drove 100.0 m, lateral error 0.100 m RMS")
    assert kept(lane(99.9))[0] == "time_up"


def test_a_rest_on_the_way_is_false_braking_and_never_moving_is_none():
    assert kept(lane(50.0), (5.0, 0.0)) == (
        "false_braking",
        "came to rest after 50.0 m of 100 m",
    )
    assert kept(lane(0.0), (0.0, 0.0)) == (
        "time_up",
        "time is up at 0.00 m/s, after 0.0 m of 100 m",
    )
    assert kept(lane(50.0), (5.0, 1.0))[0] == "time_up"
    assert kept(lane(50.0), (0.0, 5.0, 2.0))[1].startswith("time is up at 2.00 m/s")


@pytest.mark.parametrize(
    ("distance_m", "lateral_m", "left"),
    [(99.9, 0.75, False), (100.0, 0.0, True), (50.0, 0.751, True), (50.0, -0.751, True)],
)
def test_a_case_ends_where_the_lane_does_or_beside_it(distance_m, lateral_m, left):
    assert lane(distance_m, lateral_m).ended() is left


@pytest.mark.parametrize(("hit", "what"), [(VAN, " with 'van' (car, hull 2 of 3)"), (None, "")])
def test_a_collision_says_how_fast_when_and_with_what(hit, what):
    found, state = rows((5.0, 0.0))
    state[COLUMN["collisions"]] = 1.0
    state[COLUMN["impact_speed_mps"]], state[COLUMN["impact_step"]] = 6.25, 1_234_567.0
    for way in (families.begin(Scenario(), GROUND, 0.0, 0.0), lane(120.0)):
        result = judge(found, state, way, hit)
        assert result.verdict == "collision"
        assert result.reasons == [f"collision at 6.25 m/s after 2469.134 s{what}"]
    known = names(found, state, hit)
    if hit is None:
        assert known == {}
    else:
        assert known == {"hit_object": "van", "hit_class": "car", "nearest_object": "van"}
    assert scalars(found, state, lane(1.0), hit)["hit_hull"] == (2 if hit else None)
    assert scalars(found, state, lane(1.0), hit)["nearest_min_m"] == 0.0


def test_what_was_not_hit_has_no_name():
    found, state = rows((5.0, 5.0))
    assert names(found, state, VAN) == {}
    assert scalars(found, state, lane(1.0), VAN)["hit_hull"] is None
