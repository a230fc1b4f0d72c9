"""devkit.fusion.path: places beside arcs and their tangents, against drives in small steps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from devkit.fusion.path import FAR_M, CarPath

BENDS = (0.0, 1e-12, 0.004, -0.004, 0.1, -0.1)


def driven(bend_per_m: float, turns_on_m: float, way_m: float) -> tuple[float, float, float]:
    """x, y and direction after a way along an arc and on along its tangent."""
    x = y = heading = 0.0
    step_m = 1e-3
    for k in range(round(way_m / step_m)):
        bend = bend_per_m if k * step_m < turns_on_m else 0.0
        heading += 0.5 * bend * step_m
        x, y = x + step_m * math.cos(heading), y + step_m * math.sin(heading)
        heading += 0.5 * bend * step_m
    return x, y, heading


@pytest.mark.parametrize("bend", BENDS)
def test_places_beside_an_arc_are_as_far_as_from_its_circle(bend):
    for x, y in ((0.0, 3.0), (5.0, -2.0), (9.0, 4.0), (60.0, -9.0)):
        centre = math.hypot(x, y - 1.0 / bend) if abs(bend) > 1e-9 else 0.0
        exact = 1.0 / bend - math.copysign(centre, bend) if centre else y
        if 1.0 - bend * y > 0.0:
            assert CarPath(bend).beside_arc_m(x, y) == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize("bend", BENDS)
def test_a_place_keeps_its_distance_from_the_circle_while_the_car_drives_on(bend):
    """Also beyond a quarter of the circle, where there is no path."""
    for at_x, at_y in ((25.0, 4.0), (3.0, 14.0), (12.0, -18.0)):
        before = CarPath(bend).beside_circle_m(at_x, at_y)
        x, y, heading = driven(bend, math.inf, 8.0)
        c, s = math.cos(heading), math.sin(heading)
        now = (at_x - x) * c + (at_y - y) * s, (at_y - y) * c - (at_x - x) * s
        assert CarPath(bend).beside_circle_m(*now) == pytest.approx(before, abs=1e-5)


@pytest.mark.parametrize("bend", BENDS)
@pytest.mark.parametrize("aside_m", [-1.5, 0.0, 2.5])
def test_a_place_beside_the_driven_way_is_as_far_from_the_second_path(bend, aside_m):
    path = CarPath(bend, 6.0)
    for way_m in (1.0, 5.5, 6.5, 30.0):
        x, y, heading = driven(bend, 6.0, way_m)
        x, y = x - aside_m * math.sin(heading), y + aside_m * math.cos(heading)
        assert path.beside_second_m(x, y) == pytest.approx(aside_m, abs=0.01)


def test_beyond_a_quarter_of_a_turn_there_is_no_path():
    assert CarPath(0.1).beside_arc_m(0.5, 19.9) == FAR_M, "half way round, on the circle"
    assert CarPath(-0.1).beside_arc_m(0.5, -19.9) == -FAR_M
    assert not CarPath(0.1).holds(0.5, 19.0, 20.5, 1.1)
    assert CarPath(0.1).holds(8.66, 4.5, 5.5, 1.1), "at 60 degrees it is"


def test_what_is_in_the_way_lies_on_both_paths():
    """8 m/s^2 aside at 16 m/s for another 10 m, then straight on."""
    arc, turns_on = CarPath(0.01), CarPath(0.01, 10.0)
    assert arc.holds(40.0, 7.0, 9.0, 1.1)
    assert not turns_on.holds(40.0, 7.0, 9.0, 1.1)
    assert not turns_on.holds(40.0, 2.5, 4.5, 1.1), "on the second path alone"
    assert turns_on.holds(12.0, 0.0, 1.5, 1.1)


def test_arrays_say_the_same_as_each_slot_alone():
    rng = np.random.default_rng(7)
    bend, on_m = rng.normal(0.0, 0.03, 5), np.array([np.inf, 3.0, 8.0, 0.0, 40.0])
    x, right = rng.uniform(1.0, 50.0, (5, 4)), rng.normal(0.0, 4.0, (5, 4))
    together = CarPath(bend, on_m).spread(2).holds(x, right, right + 1.8, 1.1)
    for slot in range(5):
        one = CarPath(bend, on_m).of_slot(slot)
        alone = [
            bool(one.holds(x[slot, k], right[slot, k], right[slot, k] + 1.8, 1.1)) for k in range(4)
        ]
        assert together[slot].tolist() == alone


def test_a_curve_that_begins_passes_what_is_parked_beside_it():
    """A clothoid of 30 m to a radius of 200 m, 10 m after its beginning: a car that stands at its
    right edge, 2 m from its middle, lies on the arc."""
    growth = 1.0 / (200.0 * 30.0)
    bend, x_m = 10.0 * growth, 28.0
    way_m = 20.0
    road_m = 0.5 * bend * way_m**2 + growth * way_m**3 / 6.0
    slope = bend * way_m + 0.5 * growth * way_m**2
    road_m += slope * (x_m - way_m) + 0.5 * 30.0 * growth * (x_m - way_m) ** 2
    right, left = road_m - 2.0 - 0.9, road_m - 2.0 + 0.9
    assert CarPath(bend).holds(x_m, right, left, 1.1)
    assert not CarPath(bend, grows_per_m2=growth).holds(x_m, right, left, 1.1)
    assert CarPath(bend, grows_per_m2=growth).holds(x_m, road_m - 0.9, road_m + 0.9, 1.1)


def test_a_curvature_grows_for_thirty_metres():
    """Beside a reference of small steps."""
    growth, step_m = 2e-4, 0.01
    y, slope, bend = 0.0, 0.0, 0.0
    for k in range(5000):
        y, slope = y + slope * step_m, slope + bend * step_m
        bend = min(bend + growth * step_m, 30.0 * growth)
        if k + 1 in (2000, 4000):
            path = CarPath(0.0, grows_per_m2=growth)
            found = path.beside_growing_m((k + 1) * step_m)
            assert found == pytest.approx(y, abs=0.02)
