"""The curves of poly3 and paramPoly3: u(p), v(p), measured along the way.

s is the length of the way along the reference line, so p follows from s by the length of the curve,
whatever ``pRange`` calls p. Where the curve of a paramPoly3 is not as long as its ``length`` says,
s is stretched so that its end is the end of p; a poly3 ends where it is long enough.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.road.opendrive.quadrature import integrate

_PANELS = 64
_STEPS = 40
"""Of the search for p: Newton's, halving where that would leave the panel."""
SPEED_MIN = 1e-3
"""Least of |d(u, v) / dp|, as a share of its largest: a curve that stands still has no heading."""


@dataclass(frozen=True, slots=True)
class CubicCurve:
    """u(p) and v(p); make it with :func:`cubic_curve`."""

    u: tuple[float, float, float, float]
    v: tuple[float, float, float, float]
    knots: np.ndarray
    """p where panels begin, and the end [P + 1]."""
    ways: np.ndarray
    """Length of the curve up to them [P + 1] [m]."""
    stretch: float
    """Metres of the curve per metre of s."""

    def parameter(self, s_m: np.ndarray) -> np.ndarray:
        """p after ``s_m`` from its beginning."""
        way = s_m * self.stretch
        panel = np.clip(np.searchsorted(self.ways, way, "right") - 1, 0, len(self.ways) - 2)
        start, end = self.knots[panel], self.knots[panel + 1]
        rest = way - self.ways[panel]
        low, high = start, end
        p = start + (end - start) * rest / (self.ways[panel + 1] - self.ways[panel])
        for _ in range(_STEPS):
            p = np.clip(p, low, high)
            short = integrate(self.speed, start, p) - rest
            low, high = np.where(short < 0.0, p, low), np.where(short < 0.0, high, p)
            newton = p - short / self.speed(p)
            settled = np.where((newton < low) | (newton > high), 0.5 * (low + high), newton)
            if np.array_equal(settled, p):
                break
            p = settled
        within: np.ndarray = np.clip(p, start, end)
        return within

    def speed(self, p: np.ndarray) -> np.ndarray:
        """Metres of the curve per p."""
        du, dv = _slope(self.u, p), _slope(self.v, p)
        speed: np.ndarray = np.sqrt(du * du + dv * dv)
        return speed

    def at(self, s_m: np.ndarray) -> tuple[np.ndarray, ...]:
        """u, v [m], the direction's cosine and sine in their axes, and the curvature [1/m]."""
        p = self.parameter(s_m)
        du, dv = _slope(self.u, p), _slope(self.v, p)
        ddu, ddv = (2.0 * c[2] + 6.0 * c[3] * p for c in (self.u, self.v))
        speed = self.speed(p)
        curvature = (du * ddv - dv * ddu) / (speed * speed * speed)
        return _value(self.u, p), _value(self.v, p), du / speed, dv / speed, curvature


def cubic_curve(
    u: tuple[float, float, float, float],
    v: tuple[float, float, float, float],
    p_max: float | None,
    length_m: float,
) -> CubicCurve:
    """The curve of ``length_m``; ``p_max`` None: where p ends follows from the length.

    Raises:
        ValueError: the curve stands still somewhere.
    """
    # A poly3 has u = p, so its curve is at least as long as p.
    end = length_m if p_max is None else p_max
    knots = end * np.arange(_PANELS + 1) / _PANELS
    curve = CubicCurve(u, v, knots, knots, 1.0)
    speeds = curve.speed(knots)
    if not speeds.min() > SPEED_MIN * speeds.max():
        raise ValueError("the curve stands still somewhere, so it has no direction there")
    ways = np.zeros(_PANELS + 1)
    for panel, step in enumerate(integrate(curve.speed, knots[:-1], knots[1:])):
        ways[panel + 1] = ways[panel] + step
    if p_max is not None:
        return CubicCurve(u, v, knots, ways, float(ways[-1]) / length_m)
    measured = CubicCurve(u, v, knots, ways, 1.0)
    # Panels as fine as the piece is: the curve may be longer than what is used of it.
    return cubic_curve(u, v, float(measured.parameter(np.array(length_m))), length_m)


def _value(c: tuple[float, float, float, float], p: np.ndarray) -> np.ndarray:
    return c[0] + p * (c[1] + p * (c[2] + p * c[3]))


def _slope(c: tuple[float, float, float, float], p: np.ndarray) -> np.ndarray:
    return c[1] + p * (2.0 * c[2] + p * 3.0 * c[3])
