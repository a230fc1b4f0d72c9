"""twin.road.opendrive.reference_line: every shape by hand, or by dense quadrature."""

from __future__ import annotations

import math

import numpy as np
import pytest
from road_files import LINE, geometry, road, xodr

from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.reference_line import ReferenceLine, reference_line

GRID_M = 2.0**-30
EXACT_M = 1e-9
"""The bound that twin.road.opendrive.clothoid derives."""


def of(length: float, *pieces: str) -> ReferenceLine:
    return reference_line(read_network(xodr(road(length, "".join(pieces))), "t").roads["0"])


def test_a_line_goes_straight():
    line = of(100.0, geometry(LINE, 100.0, at=(3.0, 4.0, math.atan2(4.0, 3.0))))
    place = line.at(np.array([0.0, 50.0, 100.0]))
    np.testing.assert_allclose(place.x_m, [3.0, 33.0, 63.0], atol=EXACT_M)
    np.testing.assert_allclose(place.y_m, [4.0, 44.0, 84.0], atol=EXACT_M)
    assert np.all(place.curvature_per_m == 0.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_arc_is_a_circle(sign: float):
    radius, turn = 20.0, 1.5 * math.pi
    shape = f'<arc curvature="{sign / radius!r}"/>'
    line = of(radius * turn, geometry(shape, radius * turn))
    s = radius * np.linspace(0.0, turn, 31)
    place = line.at(s)
    np.testing.assert_allclose(place.x_m, radius * np.sin(s / radius), atol=EXACT_M)
    np.testing.assert_allclose(place.y_m, sign * radius * (1 - np.cos(s / radius)), atol=EXACT_M)
    assert np.all(place.heading_rad >= -math.pi)
    assert np.all(place.heading_rad < math.pi)


def integrated(curvature: float, rate: float, s: float) -> tuple[float, float]:
    """A spiral by Gauss-Legendre quadrature with 40 nodes on each of 100 panels."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    half = 0.5 * s / 100
    u = (half * (2 * np.arange(100)[:, None] + 1) + half * nodes).ravel()
    turned = u * (curvature + 0.5 * rate * u)
    shares = half * np.tile(weights, 100)
    return math.fsum(shares * np.cos(turned)), math.fsum(shares * np.sin(turned))


@pytest.mark.parametrize(
    ("start", "end", "length"),
    [
        (0.0, 0.004, 100.0),
        (0.1, -0.1, 60.0),
        (-0.02, -0.3, 45.0),
        (0.0, 1.0, 30.0),
        (0.01, 0.01, 90),
    ],
)
def test_a_spiral_is_within_its_bound(start: float, end: float, length: float):
    shape = f'<spiral curvStart="{start!r}" curvEnd="{end!r}"/>'
    line = of(float(length), geometry(shape, float(length)))
    rate = (end - start) / length
    for s in (0.1 * length, 0.5 * length, 0.77 * length, float(length)):
        x, y = integrated(start, rate, s)
        place = line.at(s)
        assert math.hypot(float(place.x_m) - x, float(place.y_m) - y) <= EXACT_M
        assert float(place.curvature_per_m) == pytest.approx(start + rate * s, abs=1e-12)


@pytest.mark.parametrize("p_range", ["arcLength", "normalized"])
def test_a_cubic_is_measured_along_its_way(p_range: str):
    # u = p^2, v = p^3 - p / 3: a curve of length p^3 + p / 3, since |r'| = 3 p^2 + 1 / 3.
    a, b = 1.0, 2.0
    length = (b**3 + b / 3) - (a**3 + a / 3)
    # From p = 1 on: with q = p - 1, u = 1 + 2 q + q^2, v = 2/3 + 8/3 q + 3 q^2 + q^3.
    scale = 1.0 if p_range == "normalized" else 1.0 / length
    c = [2 / math.sqrt(3), scale]
    u = [0.0, 2 * c[1] * c[0], c[1] ** 2 * c[0], 0.0]
    v = [0.0, 8 / 3 * c[1], 3 * c[1] ** 2, c[1] ** 3]
    # |r'|^2 = c0^2 (2 p)^2 + (3 p^2 - 1/3)^2 with c0^2 = 1 would be (3 p^2 + 1/3)^2.
    u = [value / c[0] for value in u]
    names = [
        f'{letter}{axis}="{value!r}"'
        for axis, row in (("U", u), ("V", v))
        for letter, value in zip("abcd", row, strict=True)
    ]
    shape = f'<paramPoly3 pRange="{p_range}" {" ".join(names)}/>'
    line = of(length, geometry(shape, length))
    for p in (1.0, 1.2, 1.7, 2.0):
        s = (p**3 + p / 3) - (a**3 + a / 3)
        place = line.at(s)
        assert float(place.x_m) == pytest.approx(p**2 - 1, abs=EXACT_M)
        assert float(place.y_m) == pytest.approx(p**3 - p / 3 - 2 / 3, abs=EXACT_M)
        heading = math.atan2(3 * p * p - 1 / 3, 2 * p)
        assert float(place.heading_rad) == pytest.approx(heading, abs=EXACT_M)


def test_a_poly3_ends_where_it_is_long_enough():
    # v = u^2 / 2 is as long as (u sqrt(1 + u^2) + asinh u) / 2.
    end = 3.0
    length = 0.5 * (end * math.sqrt(1 + end * end) + math.asinh(end))
    line = of(length, geometry('<poly3 a="0" b="0" c="0.5" d="0"/>', length))
    place = line.at(length)
    assert float(place.x_m) == pytest.approx(end, abs=EXACT_M)
    assert float(place.y_m) == pytest.approx(0.5 * end * end, abs=EXACT_M)
    assert float(line.at(0.0).curvature_per_m) == pytest.approx(1.0, abs=1e-12)


def test_a_curve_that_stands_still_is_refused():
    shape = (
        '<paramPoly3 pRange="normalized" aU="0" bU="0" cU="1" dU="0" aV="0" bV="0" cV="0" dV="0"/>'
    )
    with pytest.raises(ValueError, match="stands still"):
        of(1.0, geometry(shape, 1.0))


def test_places_lie_on_the_grid():
    line = of(60.0, geometry('<spiral curvStart="0.1" curvEnd="-0.1"/>', 60.0))
    place = line.at(np.linspace(0.0, 60.0, 100))
    for values in (place.x_m, place.y_m, place.heading_rad):
        np.testing.assert_array_equal(values / GRID_M, np.rint(values / GRID_M))


def test_stations_beyond_the_ends_are_refused():
    line = of(100.0, geometry(LINE, 100.0))
    for s in (-0.1, 100.1, math.nan):
        with pytest.raises(ValueError, match="on road 0, which is 100 m long"):
            line.at(s)
    assert float(line.at(100.0 + 5e-7).x_m) == 100.0
