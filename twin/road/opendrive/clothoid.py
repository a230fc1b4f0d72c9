"""The spiral of OpenDRIVE: curvature linear along the way (a clothoid, or Euler spiral).

In the axes of its beginning, with curvature k0 there and k' = (k1 - k0) / L per metre, the heading
after s metres is h(s) = k0 s + k' s^2 / 2, and the place is the integral of (cos h, sin h).

There is no closed form. The way is cut into panels so short that on each, with h written as
h0 + a x + b x^2 over x in [-1, 1], |a| <= 1/2 and |b| <= 1/2; there Gauss-Legendre quadrature with
n = 12 nodes converges. On the Bernstein ellipse of parameter r = 6 the integrand exp(i (a x +
b x^2)) is at most M = exp(a (r - 1/r) / 2 + b (r^2 - 1/r^2) / 4) <= exp(5.96), and the error of the
rule is at most 64/15 M r^(-2 (n - 1)) / (1 - r^-2) = 2.3e-14 (Trefethen, Approximation Theory and
Approximation Practice, theorem 19.3) for a panel of length 2, so 1.2e-14 of the length of a spiral.
The grid of sines adds 3e-14 of it. A spiral of 10 km is within 1e-9 m, and results are rounded to
2^-30 m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twin.road.opendrive.grid import sine_cosine
from twin.road.opendrive.quadrature import integrate_both


@dataclass(frozen=True, slots=True)
class Clothoid:
    """A spiral cut into panels; make it with :func:`clothoid`."""

    curvature: float
    """At its beginning [1/m]."""
    rate: float
    """Change of the curvature per metre [1/m^2]."""
    knots: np.ndarray
    """Where panels begin, and the end [P + 1] [m]."""
    places: np.ndarray
    """x, y at the knots, in the axes of its beginning [P + 1, 2] [m]."""

    def at(self, s_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x and y after ``s_m`` from its beginning, in the axes there."""
        panel = np.clip(np.searchsorted(self.knots, s_m, "right") - 1, 0, len(self.knots) - 2)
        start = self.knots[panel]
        aside, ahead = integrate_both(lambda s: sine_cosine(self.heading(s)), start, s_m)
        return self.places[panel, 0] + ahead, self.places[panel, 1] + aside

    def heading(self, s_m: np.ndarray) -> np.ndarray:
        """Turned since its beginning [rad]."""
        return s_m * (self.curvature + 0.5 * self.rate * s_m)


def clothoid(start_per_m: float, end_per_m: float, length_m: float) -> Clothoid:
    """The spiral between two curvatures [1/m]."""
    rate = (end_per_m - start_per_m) / length_m
    # a = k h / 2 and b = k' h^2 / 8 of a panel of length h, k its largest curvature.
    tightest = max(abs(start_per_m), abs(end_per_m))
    count = math.ceil(max(tightest * length_m, 0.5 * math.sqrt(abs(rate)) * length_m, 1.0))
    knots = length_m * np.arange(count + 1) / count
    empty = Clothoid(start_per_m, rate, knots, np.zeros((count + 1, 2)))
    aside, ahead = integrate_both(lambda s: sine_cosine(empty.heading(s)), knots[:-1], knots[1:])
    places = np.zeros((count + 1, 2))
    for panel in range(count):
        places[panel + 1] = places[panel] + (ahead[panel], aside[panel])
    return Clothoid(start_per_m, rate, knots, places)
