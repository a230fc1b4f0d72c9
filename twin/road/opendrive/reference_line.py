"""The reference line of a road: places in the plane by station, and the nearest station."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from twin.road.opendrive.clothoid import Clothoid, clothoid
from twin.road.opendrive.cubic_curve import CubicCurve, cubic_curve
from twin.road.opendrive.grid import angle_of, chord_share, settled, sine_cosine, turned
from twin.road.opendrive.records import GeometryRecord, RoadRecord

OUTSIDE_M = 1e-6
"""How far beyond its ends a station still belongs to a road [m]."""
_CHUNK = 1 << 20
_STEPS = 24
_SAMPLE_M = 5.0
_SAMPLE_TURN_RAD = 0.1


class LinePlace(NamedTuple):
    """Places on a reference line; arrays of one shape."""

    x_m: np.ndarray
    y_m: np.ndarray
    cosine: np.ndarray
    """Of the heading."""
    sine: np.ndarray
    heading_rad: np.ndarray
    """In [-pi, pi) [rad]."""
    curvature_per_m: np.ndarray
    """To the left positive [1/m]."""


@dataclass(frozen=True, slots=True)
class ReferenceLine:
    """Make it with :func:`reference_line`."""

    road_id: str
    length_m: float
    pieces: tuple[GeometryRecord, ...]
    curves: tuple[Clothoid | CubicCurve | None, ...]
    """Of each piece; None: a line or an arc."""
    starts: np.ndarray
    """Stations of the pieces [P] [m]."""
    sample_s: np.ndarray
    """Stations at most 5 m and 0.1 rad apart [M] [m]."""
    sample_x: np.ndarray
    sample_y: np.ndarray

    def at(self, s_m: float | np.ndarray) -> LinePlace:
        """Places at stations of any shape.

        Raises:
            ValueError: a station lies beyond the ends of the road.
        """
        s = np.asarray(s_m, float)
        self.check(s)
        s = np.clip(s, 0.0, self.length_m)
        flat = s.ravel()
        index = np.maximum(np.searchsorted(self.starts, flat, "right") - 1, 0)
        out = np.empty((5, len(flat)))
        for k in np.unique(index).tolist():
            mine = index == k
            out[:, mine] = self.on_piece(k, flat[mine])
        x, y, c, si, curvature = out.reshape((5, *s.shape))
        heading = turned(angle_of(si, c))
        return LinePlace(settled(x), settled(y), c, si, settled(heading), curvature)

    def check(self, s: np.ndarray) -> None:
        """Refuse stations beyond the ends.

        Raises:
            ValueError: there is one.
        """
        outside = ~((s >= -OUTSIDE_M) & (s <= self.length_m + OUTSIDE_M))
        if outside.any():
            worst = s[outside].ravel()[0]
            raise ValueError(
                f"s={worst:g} m on road {self.road_id[:40]}, which is {self.length_m:g} m long"
            )

    def nearest(
        self, x_m: np.ndarray, y_m: np.ndarray, near_s_m: np.ndarray | None, within_m: float
    ) -> np.ndarray:
        """Stations of the feet of points; of equally near ones the first.

        Args:
            x_m, y_m: world [N].
            near_s_m: where each point was before [N]; None: anywhere.
            within_m: how far from there a foot may be.
        """
        s = np.empty(len(x_m))
        rows = max(1, _CHUNK // len(self.sample_s))
        for begin in range(0, len(x_m), rows):
            part = slice(begin, begin + rows)
            near = None if near_s_m is None else near_s_m[part]
            s[part] = self._nearest(x_m[part], y_m[part], near, within_m)
        return settled(s)

    def _nearest(
        self, x: np.ndarray, y: np.ndarray, near: np.ndarray | None, within_m: float
    ) -> np.ndarray:
        # The nearest chord, then the foot on the curve between its ends and one more each way.
        ax, ay = self.sample_x[:-1], self.sample_y[:-1]
        ex, ey = np.diff(self.sample_x), np.diff(self.sample_y)
        square = np.maximum(ex * ex + ey * ey, 1e-300)
        dx, dy = x[:, None] - ax, y[:, None] - ay
        share = np.clip((dx * ex + dy * ey) / square, 0.0, 1.0)
        off_x, off_y = dx - share * ex, dy - share * ey
        distance = off_x * off_x + off_y * off_y
        low_limit, high_limit = np.zeros(len(x)), np.full(len(x), self.length_m)
        if near is not None:
            centre = np.clip(near, 0.0, self.length_m)
            low_limit = np.maximum(low_limit, centre - within_m)
            high_limit = np.minimum(high_limit, centre + within_m)
            reach = (self.sample_s[1:] >= low_limit[:, None]) & (
                self.sample_s[:-1] <= high_limit[:, None]
            )
            distance = np.where(reach, distance, np.inf)
        k = np.argmin(settled(distance), axis=1)
        last = len(self.sample_s) - 1
        low = np.maximum(self.sample_s[np.maximum(k - 1, 0)], low_limit)
        high = np.minimum(self.sample_s[np.minimum(k + 2, last)], high_limit)
        row = np.arange(len(x))
        s = self.sample_s[k] + share[row, k] * (self.sample_s[k + 1] - self.sample_s[k])
        return self._foot(x, y, np.clip(s, low, high), low, high)

    def _foot(
        self, x: np.ndarray, y: np.ndarray, s: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> np.ndarray:
        """Newton's steps on the distance along the tangent, halving where they would leave."""
        for _ in range(_STEPS):
            place = self.at(s)
            dx, dy = x - place.x_m, y - place.y_m
            ahead = place.cosine * dx + place.sine * dy
            beside = place.cosine * dy - place.sine * dx
            low, high = np.where(ahead > 0.0, s, low), np.where(ahead > 0.0, high, s)
            slope = 1.0 - place.curvature_per_m * beside
            step = ahead / np.where(slope > 0.05, slope, 1.0)
            further = s + step
            outside = (further < low) | (further > high)
            # At an end of the road the foot is the end.
            s = np.where(outside, np.where(ahead > 0.0, 0.5 * (s + high), 0.5 * (s + low)), further)
        return s

    def on_piece(self, k: int, s: np.ndarray) -> np.ndarray:
        """Places at stations of the piece with number ``k``: x, y, cosine and sine of the heading,
        curvature [5, N]; beyond its ends it goes on."""
        piece, curve = self.pieces[k], self.curves[k]
        ahead = s - piece.start_m
        s0, c0 = (float(value) for value in sine_cosine(piece.heading_rad))
        if isinstance(curve, CubicCurve):
            u, v, c1, s1, curvature = curve.at(ahead)
        elif curve is None:
            curvature = np.full(len(s), piece.curvature[0])
            half = 0.5 * curvature * ahead
            chord = ahead * chord_share(half)
            up, across = sine_cosine(half)
            u, v = chord * across, chord * up
            s1, c1 = sine_cosine(2.0 * half)
        else:
            u, v = curve.at(ahead)
            s1, c1 = sine_cosine(curve.heading(ahead))
            curvature = curve.curvature + curve.rate * ahead
        return np.stack(
            [
                piece.x_m + c0 * u - s0 * v,
                piece.y_m + s0 * u + c0 * v,
                c0 * c1 - s0 * s1,
                s0 * c1 + c0 * s1,
                curvature,
            ]
        )


def reference_line(road: RoadRecord) -> ReferenceLine:
    """The reference line of ``road``.

    Raises:
        ValueError: a curve has no direction somewhere; names the line of the file.
    """
    curves: list[Clothoid | CubicCurve | None] = []
    for piece in road.geometry:
        if piece.kind == "spiral":
            curves.append(clothoid(*piece.curvature, piece.length_m))
        elif piece.kind == "cubic":
            try:
                curves.append(cubic_curve(piece.u, piece.v, piece.p_max, piece.length_m))
            except ValueError as error:
                raise ValueError(f"line {piece.line}: {error}") from None
        else:
            curves.append(None)
    starts = np.array([piece.start_m for piece in road.geometry])
    samples = _samples(road)
    bare = ReferenceLine(
        road.id, road.length_m, road.geometry, tuple(curves), starts, samples, samples, samples
    )
    place = bare.at(samples)
    return ReferenceLine(
        road.id,
        road.length_m,
        road.geometry,
        tuple(curves),
        starts,
        samples,
        place.x_m,
        place.y_m,
    )


def _samples(road: RoadRecord) -> np.ndarray:
    ends = [min(piece.start_m, road.length_m) for piece in road.geometry[1:]] + [road.length_m]
    parts, begin = [], 0.0
    for piece, end in zip(road.geometry, ends, strict=True):
        length = max(end - begin, 0.0)
        turn = max(map(abs, piece.curvature)) * length
        count = max(length / _SAMPLE_M, turn / _SAMPLE_TURN_RAD, 1.0)
        if piece.kind == "cubic":
            count = max(count, 64.0)
        parts.append(begin + length * np.arange(math.ceil(count)) / math.ceil(count))
        begin = max(end, begin)
    stations: np.ndarray = np.unique(np.append(np.concatenate(parts), road.length_m))
    return stations
