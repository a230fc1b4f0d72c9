"""A search on the vehicle model finds the probability that a grid of cars has."""

from __future__ import annotations

import numpy as np
import pytest
from search_braking import SETTINGS, SLOTS, BrakingRoad, closed_m, run, truth

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def road() -> BrakingRoad:
    return BrakingRoad("cpu", SLOTS // 4)


def test_cars_brake_nearly_as_the_closed_form_has_it(road: BrakingRoad) -> None:
    friction, speed = np.array([0.35, 0.45, 0.55]), np.array([17.0, 13.0, 10.0])
    latency = np.array([250.0, 150.0, 50.0])
    found, expected = road.distances_m(friction, speed, latency), closed_m(friction, speed, latency)
    assert found == pytest.approx(expected, rel=0.05)
    assert np.all(np.abs(found - expected) > 0.01)


def test_most_intervals_cover_the_probability_that_a_grid_has(road: BrakingRoad) -> None:
    right = truth(road, nodes=12)
    assert right.coarse == pytest.approx(right.probability, rel=2e-3)
    assert right.closed == pytest.approx(right.probability, rel=0.1)
    estimates = [found.estimate for found in run(road, SETTINGS, range(6))]
    covers = [(e.low or 0.0) <= right.probability <= (e.high or 0.0) for e in estimates]
    assert sum(covers) >= 4
