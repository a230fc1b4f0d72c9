"""Rational B-splines by the distance along them (Piegl and Tiller, The NURBS Book, 2nd edition).

Basis functions follow the recurrence of Cox and de Boor (equation 2.5 there), and derivatives of
the rational curve come from those of its homogeneous coordinates (equation 4.8).
"""

from __future__ import annotations

import math

import numpy as np

from twin.road.opendrive.grid import settled
from twin.road.opendrive.quadrature import integrate
from twin.scenario.storyboard.compile.curves import LinePoints

_PANELS = 16
"""Panels of a knot span, over which the length is integrated."""
_STEPS = 60
_NEAR = 1e-13
"""Of the largest knot: no more steps."""
ORDER_MAX = 16


class NurbsCurve:
    """A rational B-spline, by the distance from its beginning.

    Args:
        controls: x, y, z [m] and weight of the control points [N, 4].
        knots: rising [N + order].
        order: degree + 1.
        times: of the control points [N] [s].

    Raises:
        ValueError: order, knots or weights do not make a curve, or it stands still somewhere.
    """

    def __init__(
        self, controls: np.ndarray, knots: np.ndarray, order: int, times: np.ndarray
    ) -> None:
        count = len(controls)
        if not 2 <= order <= min(count, ORDER_MAX):
            most = min(count, ORDER_MAX)
            raise ValueError(f"order is {order}, it must be from 2 to {most}")
        if len(knots) != count + order:
            raise ValueError(f"{len(knots)} knots, {count + order} are needed")
        if (np.diff(knots) < 0.0).any() or not knots[order - 1] < knots[count]:
            raise ValueError("knots must not fall, and those of the curve must rise")
        if not (controls[:, 3] > 0.0).all():
            raise ValueError("weights must be above 0")
        self._knots, self._order = knots, order
        weights = controls[:, 3:]
        self._points = np.hstack([controls[:, :3] * weights, times[:, None] * weights, weights])
        spans = np.unique(knots[order - 1 : count + 1])
        self._spans = spans
        parts = [self._homogeneous(spans[:-1], d) / math.factorial(d) for d in range(order)]
        self._taylor = np.array(parts).transpose(0, 2, 1)
        """Polynomials of the spans from their beginnings [order, spans, 5]."""
        shares = np.arange(_PANELS) / _PANELS
        self._breaks = np.append(
            (spans[:-1, None] + np.diff(spans)[:, None] * shares).ravel(), spans[-1]
        )
        lengths = integrate(self._speed, self._breaks[:-1], self._breaks[1:])
        if not (lengths > 1e-9).all():
            raise ValueError("the curve stands still somewhere, so it has no direction there")
        self._ways = settled(np.append(0.0, np.cumsum(lengths)))
        self.stations = self._ways[::_PANELS]
        """Distances at the knots, the ends among them [m]."""

    def line(self, s_m: np.ndarray) -> LinePoints:
        """Points at distances."""
        u = self._parameter(s_m)
        place, slope, bend = self._rational(u)
        speed = np.sqrt((slope[:3] * slope[:3]).sum(axis=0))
        level = slope[0] * slope[0] + slope[1] * slope[1]
        turn = (slope[0] * bend[1] - slope[1] * bend[0]) / np.maximum(level, 1e-300)
        heading = self._unwrapped(u, np.arctan2(slope[1], slope[0]))
        return LinePoints(place[0], place[1], place[2], slope[2] / speed, heading, turn / speed)

    def times(self, s_m: np.ndarray) -> np.ndarray:
        """Times at distances, as the curve makes them of those of its control points [s]."""
        times: np.ndarray = self._rational(self._parameter(s_m))[0][3]
        return times

    def _unwrapped(self, u: np.ndarray, heading: np.ndarray) -> np.ndarray:
        """Headings without jumps: each within half a turn of that at the break before it."""
        slope = self._rational(self._breaks)[1]
        known = np.unwrap(np.arctan2(slope[1], slope[0]))
        index = np.clip(np.searchsorted(self._breaks, u, "right") - 1, 0, len(known) - 1)
        near = known[index]
        unwrapped: np.ndarray = near + np.remainder(heading - near + np.pi, 2.0 * np.pi) - np.pi
        return unwrapped

    def _parameter(self, s_m: np.ndarray) -> np.ndarray:
        """u at distances: Newton's steps, halving where they would leave the panel."""
        s = np.clip(s_m, 0.0, self._ways[-1])
        panel = np.clip(np.searchsorted(self._ways, s, "right") - 1, 0, len(self._ways) - 2)
        low, high = self._breaks[panel], self._breaks[panel + 1]
        begin, rest = low, s - self._ways[panel]
        u: np.ndarray = low + (high - low) * rest / (self._ways[panel + 1] - self._ways[panel])
        for _ in range(_STEPS):
            short = integrate(self._speed, begin, u) - rest
            low, high = np.where(short < 0.0, u, low), np.where(short < 0.0, high, u)
            newton = u - short / np.maximum(self._speed(u), 1e-300)
            after = np.where((newton <= low) | (newton >= high), 0.5 * (low + high), newton)
            settling = np.abs(after - u).max() <= _NEAR * np.abs(self._spans).max()
            u = after
            if settling:
                break
        return u

    def _speed(self, u: np.ndarray) -> np.ndarray:
        slope = self._rational(u)[1]
        speed: np.ndarray = np.sqrt((slope[:3] * slope[:3]).sum(axis=0))
        return speed

    def _rational(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x, y, z, time and their first and second derivatives by u, each [4, ...]."""
        index = np.clip(np.searchsorted(self._spans, u, "right") - 1, 0, len(self._spans) - 2)
        x = (u - self._spans[index])[..., None]
        value, rate, change = (np.zeros((*u.shape, 5)) for _ in range(3))
        for c in self._taylor[::-1, index]:
            change = change * x + rate
            rate = rate * x + value
            value = value * x + c
        a = [np.moveaxis(part, -1, 0) for part in (value, rate, 2.0 * change)]
        w = [part[4] for part in a]
        place = a[0][:4] / w[0]
        slope = (a[1][:4] - w[1] * place) / w[0]
        bend = (a[2][:4] - 2.0 * w[1] * slope - w[2] * place) / w[0]
        return place, slope, bend

    def _homogeneous(self, u: np.ndarray, derivative: int) -> np.ndarray:
        """Homogeneous coordinates or their derivative at u [5, ...]."""
        points, knots, order = self._points, self._knots, self._order
        for _ in range(derivative):
            degree = order - 1
            if degree == 0:
                return np.zeros((5, *u.shape))
            gaps = knots[degree + 1 : degree + len(points)] - knots[1 : len(points)]
            safe = np.where(gaps > 0.0, gaps, 1.0)
            points = degree * np.diff(points, axis=0) / safe[:, None] * (gaps > 0.0)[:, None]
            knots, order = knots[1:-1], order - 1
        basis = _basis(u, knots, order, len(points))
        homogeneous: np.ndarray = np.einsum("n...,nk->k...", basis, points)
        return homogeneous


def _basis(u: np.ndarray, knots: np.ndarray, order: int, count: int) -> np.ndarray:
    """Basis functions at u [count, ...]; the last knot belongs to the last span."""
    spans = len(knots) - 1
    last = int(np.max(np.nonzero(np.diff(knots) > 0.0)[0]))
    rows = []
    for k in range(spans):
        inside = (knots[k] <= u) & (u < knots[k + 1])
        if k == last:
            inside = inside | (u >= knots[k + 1])
        rows.append(inside.astype(float))
    for degree in range(1, order):
        after = []
        for k in range(spans - degree):
            before, behind = knots[k + degree] - knots[k], knots[k + degree + 1] - knots[k + 1]
            term = np.zeros(u.shape)
            if before > 0.0:
                term = term + (u - knots[k]) / before * rows[k]
            if behind > 0.0:
                term = term + (knots[k + degree + 1] - u) / behind * rows[k + 1]
            after.append(term)
        rows = after
    return np.array(rows[:count])
