"""The centre line of a lane: straight pieces and circular arcs that meet without a kink."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from twin.base.portable import host

_GRID = 2.0**30
"""Per metre, or per radian. Sines and arc tangents differ in their last bits between processors,
positions and stations on this grid do not."""
_FINE_GRID = 2.0**44
"""For sines, which are multiplied by lengths, and for comparing squares of distances."""


class Piece(NamedTuple):
    """A stretch of constant curvature."""

    length_m: float
    """Above 0 [m]."""
    curvature_per_m: float
    """To the left positive, 0 for a straight one [1/m]."""


class LanePose(NamedTuple):
    """Places on, or beside, a lane; arrays of one shape."""

    x_m: np.ndarray
    """World [m]."""
    y_m: np.ndarray
    yaw_rad: np.ndarray
    """Heading of the lane, in [-pi, pi) [rad]."""
    curvature_per_m: np.ndarray
    """Of the centre line, to the left positive [1/m]."""


class LanePlace(NamedTuple):
    """Where points lie as seen from a lane; arrays of one shape."""

    s_m: np.ndarray
    """Way along the centre line to the nearest place on it; of a closed lane in [0, length) [m]."""
    lateral_m: np.ndarray
    """Distance from there, to the left positive [m]."""
    heading_rad: np.ndarray
    """Heading of the lane there, in [-pi, pi) [rad]."""
    curvature_per_m: np.ndarray
    """Curvature of the lane there, to the left positive [1/m]."""


@dataclass(frozen=True, slots=True)
class LanePath:
    """P pieces in order. A closed one goes round for ever; an open one goes on straight beyond its
    ends, which must be straight pieces. Build it with :func:`trace`."""

    station_m: np.ndarray
    """Where each piece begins, along the way [P] [m]."""
    start: np.ndarray
    """World x, y [m] and heading [rad] at the beginning of each [P, 3]."""
    curvature: np.ndarray
    """Of each, to the left positive [P] [1/m]."""
    length_m: float
    """Of all of them [m]."""
    closed: bool

    def at(self, s_m: float | np.ndarray, lateral_m: float | np.ndarray = 0.0) -> LanePose:
        """The places ``lateral_m`` to the left of the stations ``s_m``; any shapes that broadcast.

        The chord of an arc from its beginning is 2 sin(k s / 2) / k long and lies halfway between
        the two headings.
        """
        s, lateral = np.broadcast_arrays(np.asarray(s_m, float), np.asarray(lateral_m, float))
        if self.closed:
            s = np.mod(s, self.length_m)
        k = np.maximum((s[..., None] >= self.station_m).sum(axis=-1) - 1, 0)
        ahead = s - self.station_m[k]
        x, y, heading = np.moveaxis(self.start[k], -1, 0)
        curvature = self.curvature[k]
        half = 0.5 * curvature * ahead
        chord = ahead * host.sine_share(half)
        yaw = heading + 2.0 * half
        x = x + chord * _cosine(heading + half) - lateral * _sine(yaw)
        y = y + chord * _sine(heading + half) + lateral * _cosine(yaw)
        return LanePose(_settled(x), _settled(y), _settled(_turned(yaw)), curvature)

    def places(self, step_m: float) -> np.ndarray:
        """World x, y [m] and heading [rad] along it [n, 3]: of a straight one its ends; of others
        places at most ``step_m`` apart. The last of a closed one is the first again."""
        s = np.array([0.0, self.length_m])
        if self.closed or len(self.curvature) > 1:
            s = np.append(np.arange(0.0, self.length_m, step_m), s[0 if self.closed else 1])
        return np.stack(self.at(s)[:3], axis=-1)

    def locate(self, x_m: float | np.ndarray, y_m: float | np.ndarray) -> LanePlace:
        """The nearest place on the centre line to the world points ``x_m``, ``y_m``; any shapes
        that broadcast. Exact in closed form; of equally near places the first counts.

        Points as far from a curve as its centre have no single answer.
        """
        x, y = np.broadcast_arrays(np.asarray(x_m, float), np.asarray(y_m, float))
        begin, heading = self.start[:, :2], self.start[:, 2]
        dx, dy = x[..., None] - begin[:, 0], y[..., None] - begin[:, 1]
        cosine, sine = _cosine(heading), _sine(heading)
        along, across = cosine * dx + sine * dy, cosine * dy - sine * dx
        length = np.diff(np.append(self.station_m, self.length_m))
        low, high = np.zeros(len(length)), length.copy()
        if not self.closed:
            low[0], high[-1] = -np.inf, np.inf
        ahead = _ahead(along, across, self.curvature, low, high)
        # What is left between the point and its foot on each piece, in the axes of the foot.
        half = 0.5 * self.curvature * ahead
        chord = ahead * host.sine_share(half)
        rest = along - chord * _cosine(half), across - chord * _sine(half)
        square = np.rint((rest[0] * rest[0] + rest[1] * rest[1]) * _FINE_GRID)
        k = np.argmin(square, axis=-1)[..., None]

        def chosen(values: np.ndarray) -> np.ndarray:
            wide = np.broadcast_to(values, ahead.shape)
            return np.take_along_axis(wide, k, axis=-1)[..., 0]

        curvature, foot = chosen(self.curvature), chosen(ahead)
        turn = curvature * foot
        flat = _cosine(turn) * chosen(rest[1]) - _sine(turn) * chosen(rest[0])
        lateral = np.where(
            curvature == 0.0, flat, _beside_arc(chosen(along), chosen(across), curvature)
        )
        s = _settled(chosen(self.station_m) + foot)
        if self.closed:
            s = np.where(s >= self.length_m, 0.0, s)
        heading_rad = _settled(_turned(chosen(heading) + turn))
        return LanePlace(s, _settled(lateral), heading_rad, curvature)

    def shorter_way(self, metres: np.ndarray) -> np.ndarray:
        """Differences of stations, any shape [m]; on a closed lane the shorter way round, in
        [-length / 2, length / 2)."""
        if not self.closed:
            return metres
        half_m = 0.5 * self.length_m
        way: np.ndarray = (metres + half_m) % self.length_m - half_m
        return way


def trace(
    start: tuple[float, float, float], pieces: Sequence[Piece], closed: bool = False
) -> LanePath:
    """Join ``pieces``, the first of which begins at ``start``: world x, y [m] and heading [rad].

    Whether a closed lane ends where it begins is for the caller to see to (:func:`end_of`).
    """
    assert pieces
    assert all(piece.length_m > 0.0 for piece in pieces), pieces
    assert closed or pieces[0].curvature_per_m == pieces[-1].curvature_per_m == 0.0, pieces
    rows, station = [start], 0.0
    stations = []
    for piece in pieces:
        stations.append(station)
        rows.append(_advanced(rows[-1], piece))
        station += piece.length_m
    curvature = np.array([piece.curvature_per_m for piece in pieces], float)
    return LanePath(np.array(stations), np.array(rows[:-1], float), curvature, station, closed)


def straight(start_x_m: float, end_x_m: float) -> LanePath:
    """The lane on the world's x axis, towards +x; its stations begin at ``start_x_m``."""
    return trace((start_x_m, 0.0, 0.0), [Piece(end_x_m - start_x_m, 0.0)])


def end_of(start: tuple[float, float, float], pieces: Sequence[Piece]) -> tuple[float, ...]:
    """World x, y [m] and heading [rad], not wrapped, at the end of ``pieces``."""
    pose = start
    for piece in pieces:
        pose = _advanced(pose, piece)
    return pose


def _advanced(pose: tuple[float, float, float], piece: Piece) -> tuple[float, float, float]:
    x, y, heading = pose
    half = 0.5 * piece.curvature_per_m * piece.length_m
    chord = piece.length_m * host.sine_share(half)
    ahead = np.array((x + chord * _cosine(heading + half), y + chord * _sine(heading + half)))
    return (*_settled(ahead).tolist(), heading + 2.0 * half)


def _ahead(
    along: np.ndarray, across: np.ndarray, curvature: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Way [..., P] from the beginning of each piece to its place nearest to a point, which lies
    ``along`` and ``across`` [..., P] in the axes of that beginning."""
    bent = curvature != 0.0
    radius = 1.0 / np.where(bent, np.abs(curvature), 1.0)
    side = np.sign(curvature)
    # About the centre of the arc; 0 at its beginning, growing in the direction of travel.
    angle = np.mod(host.angle_of(along, radius - side * across), 2.0 * np.pi)
    # What lies behind the end, up to halfway round to the beginning, is nearer to the end.
    after = 0.5 * (high / radius + 2.0 * np.pi)
    on_arc = np.where(angle > after, 0.0, np.minimum(angle * radius, high))
    return np.where(bent, on_arc, np.clip(along, low, high))


def _beside_arc(along: np.ndarray, across: np.ndarray, curvature: np.ndarray) -> np.ndarray:
    """Distance to the left of arcs, from the centre's distance: no angle takes part in it."""
    bent = np.where(curvature == 0.0, 1.0, curvature)
    radius = 1.0 / np.abs(bent)
    off = radius - np.sign(bent) * across
    beside: np.ndarray = np.sign(bent) * (radius - np.sqrt(along * along + off * off))
    return beside


def _settled(values: np.ndarray) -> np.ndarray:
    return np.rint(values * _GRID) / _GRID


def _cosine(angle: float | np.ndarray) -> np.ndarray:
    return np.rint(host.cosine(angle) * _FINE_GRID) / _FINE_GRID


def _sine(angle: float | np.ndarray) -> np.ndarray:
    return np.rint(host.sine(angle) * _FINE_GRID) / _FINE_GRID


def _turned(angle: np.ndarray) -> np.ndarray:
    """A direction in [-pi, pi)."""
    turned: np.ndarray = np.mod(angle + np.pi, 2.0 * np.pi) - np.pi
    return turned
