"""Truth of what is in the ego's way, against boxes that are moved in small steps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin.scenario.storyboard.case.way_ahead import (
    RoadBoxes,
    nearest_collision_s,
    time_to_collision_s,
)
from twin.scenario.storyboard.player.columns import Real, Whole

CAR = (2.25, 0.9)


def rows(*bodies: tuple[float, float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Entities by s, t, speed and turn, all on road 0."""
    reals = np.zeros((len(bodies), len(Real)))
    wholes = np.zeros((len(bodies), len(Whole)), np.int32)
    wholes[:, Whole.PRESENT] = 1
    for row, (s, t, speed, turn) in enumerate(bodies):
        reals[row, [Real.S, Real.T, Real.SPEED, Real.TURN]] = s, t, speed, turn
    return reals, wholes


def nearest(*bodies: tuple[float, float, float, float], margin_m: float = 0.0) -> float:
    reals, wholes = rows(*bodies)
    half = np.array([CAR] * len(bodies))
    return nearest_collision_s(reals, wholes, half, np.zeros((len(bodies), 2)), margin_m)


def test_a_slower_car_ahead_is_met_when_the_gap_is_closed():
    assert nearest((0, -2, 20, 0), (50, -2, 10, 0)) == pytest.approx((50 - 4.5) / 10)


def test_who_is_beside_or_faster_is_not_met():
    assert nearest((0, -2, 20, 0), (50, 1.6, -20, 0)) == math.inf
    assert nearest((0, -2, 20, 0), (50, -2, 25, 0)) == math.inf
    assert nearest((0, -2, 20, 0), (50, -2, 19.2, 0)) == pytest.approx(45.5 / 0.8)
    assert nearest((0, -2, 20, 0), (50, -2, 19.3, 0)) == math.inf
    assert nearest((0, -2, 20, 0), (50, -0.1, 10, 0)) == math.inf
    assert nearest((0, -2, 20, 0), (50, -0.1, 10, 0), margin_m=0.2) == pytest.approx(4.55)


def test_who_comes_up_from_behind_looks_ahead_himself():
    assert nearest((50, -2, 10, 0), (0, -2, 20, 0)) == math.inf
    assert nearest((50, 2, 10, math.pi), (100, 2, 20, math.pi)) == math.inf


def test_who_drives_against_s_meets_what_is_before_him():
    assert nearest((100, 2, 20, math.pi), (50, 2, 0, 0)) == pytest.approx((50 - 4.5) / 20)


def test_who_changes_into_the_lane_is_met_when_he_is_there():
    angle = math.atan(0.1)
    along, across = 10 * math.cos(angle), 10 * math.sin(angle)
    half_m = CAR[0] * math.cos(angle) + CAR[1] * math.sin(angle)
    wide_m = CAR[0] * math.sin(angle) + CAR[1] * math.cos(angle)
    when = max((40 - half_m - CAR[0]) / (20 - along), (3.5 - wide_m - CAR[1]) / across)
    assert nearest((0, -2, 20, 0), (40, 1.5, 10, -angle)) == pytest.approx(when)


def test_other_roads_vanished_and_flat_bodies_do_not_count():
    reals, wholes = rows((0, -2, 20, 0), (50, -2, 0, 0))
    half, centre = np.array([CAR, CAR]), np.zeros((2, 2))
    assert nearest_collision_s(reals, wholes, half, centre, 0.0) < math.inf
    for column, value in ((Whole.ROAD, 1), (Whole.PRESENT, 0)):
        other = wholes.copy()
        other[1, column] = value
        assert nearest_collision_s(reals, other, half, centre, 0.0) == math.inf
    flat = np.array([CAR, (0.0, 0.0)])
    assert nearest_collision_s(reals, wholes, flat, centre, 0.0) == math.inf


def test_it_is_the_first_overlap_of_boxes_that_move():
    draws = np.random.default_rng(5)
    times = np.arange(0.0, 12.0, 0.002)
    met = 0
    for _ in range(60):
        middle = draws.uniform([-40, -6], [40, 6], (2, 2))
        half = draws.uniform(0.4, 3.0, (2, 2))
        speed = draws.uniform([-10, -1], [10, 1], (2, 2))
        boxes = RoadBoxes(*(tuple(part.T) for part in (middle, half, speed)))
        (found,) = time_to_collision_s(boxes, 0.0)
        apart = (middle[1] - middle[0]) + times[:, None] * (speed[1] - speed[0])
        over = (np.abs(apart) < half.sum(axis=0)).all(axis=1)
        first = times[over.argmax()] if over.any() else math.inf
        if first < math.inf:
            met += 1
            assert found == pytest.approx(first, abs=0.003)
        else:
            assert found > 11.9
    assert met > 5
