"""A lane's centre line from places along it: arcs and straights that meet without a kink.

Between two poses there is a biarc, two arcs that share a tangent (Bolton 1975). Of all biarcs the
one counts whose ends are equally far from their tangents' meeting points: with v from one place to
the other, unit directions t1 and t2, and t = t1 + t2, that distance is

    d = v.v / (v.t + sqrt((v.t)^2 + 2 (1 - t1.t2) v.v))

and the arcs meet in the middle between the places, d (t1 - t2) / 2 aside.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twin.road.lane import LanePath, Piece, end_of, trace
from twin.road.opendrive.grid import angle_of, cosine, settled, sine, turned

TOLERANCE_M = 0.001
"""Farthest that a place lies from the line that is fitted, unless places are too far apart [m]."""
PIECES_MAX = 1000
"""Pieces of a fitted lane; judge.json holds them for every attempt, in 100 kB."""
_TURN_MAX_RAD = 1.0
"""Arcs of a biarc turn by no more."""
_CURVATURE_MIN_PER_M = 1e-8
"""What bends less is straight."""
_EASE_M = 0.001
"""An open lane goes on straight beyond its ends; so much of it is straight already [m]."""


class LanePoints(NamedTuple):
    """Places along the middle of a lane, arrays [P], in order."""

    x_m: np.ndarray
    y_m: np.ndarray
    heading_rad: np.ndarray
    """Heading of the lane [rad]."""


def fit_lane(points: LanePoints, *, closed: bool) -> LanePath:
    """The lane through places, from the first on, as far as :data:`PIECES_MAX` pieces reach.

    Args:
        points: at least two; a metre apart or nearer.
        closed: the last of them is the first again.
    """
    start = (float(points.x_m[0]), float(points.y_m[0]), float(points.heading_rad[0]))
    pieces = [] if closed else [Piece(_EASE_M, 0.0)]
    pose = _end(start, pieces)
    index, last = 0, len(points.x_m) - 1
    while index < last and len(pieces) < PIECES_MAX - 2:
        index, pair = _longest(points, index, pose)
        pieces += pair
        pose = _end(pose, pair)
    if closed and index < last:
        closed = False
        pieces.insert(0, Piece(_EASE_M, 0.0))
    if not closed:
        pieces.append(Piece(_EASE_M, 0.0))
    return trace(start, _merged(pieces), closed)


def _longest(
    points: LanePoints, index: int, pose: tuple[float, float, float]
) -> tuple[int, list[Piece]]:
    """The farthest place after ``index`` to which a biarc from ``pose`` leads within the
    tolerance, and its arcs; the next place if none does."""
    last = len(points.x_m) - 1
    good, bad, step = index + 1, last + 1, 2
    while index + step < bad:
        if _fits(points, index, index + step, pose):
            good, step = index + step, 2 * step
        else:
            bad = index + step
    if bad > last and good < last and _fits(points, index, last, pose):
        good = last
    bad = min(bad, last)
    while bad - good > 1:
        middle = (good + bad) // 2
        if _fits(points, index, middle, pose):
            good = middle
        else:
            bad = middle
    return good, _biarc(pose, _pose(points, good))


def _fits(points: LanePoints, index: int, end: int, pose: tuple[float, float, float]) -> bool:
    """Whether all places up to ``end`` lie within the tolerance beside the biarc."""
    between = slice(index + 1, end + 1)
    turns = turned(points.heading_rad[between] - pose[2])
    if np.abs(turns).max() > _TURN_MAX_RAD:
        return False
    first, second = _biarc(pose, _pose(points, end))
    joint = _end(pose, [first])
    x, y = points.x_m[between], points.y_m[between]
    after = (x - joint[0]) * cosine(joint[2]) + (y - joint[1]) * sine(joint[2]) > 0.0
    beside = np.where(
        after,
        _beside(joint, second.curvature_per_m, x, y),
        _beside(pose, first.curvature_per_m, x, y),
    )
    return bool(np.abs(beside).max() <= TOLERANCE_M)


def _beside(
    pose: tuple[float, float, float], curvature: float, x: np.ndarray, y: np.ndarray
) -> np.ndarray:
    """How far points lie to the left of the arc that begins at ``pose``."""
    dx, dy = x - pose[0], y - pose[1]
    left = cosine(pose[2]) * dy - sine(pose[2]) * dx
    square = dx * dx + dy * dy
    root = np.sqrt(np.maximum(1.0 - 2.0 * curvature * left + curvature * curvature * square, 0.0))
    beside: np.ndarray = (2.0 * left - curvature * square) / (1.0 + root)
    return beside


def _biarc(start: tuple[float, float, float], end: tuple[float, float, float]) -> list[Piece]:
    """The two arcs from pose to pose."""
    p1, p2 = np.array(start[:2]), np.array(end[:2])
    t1 = np.array([cosine(start[2]), sine(start[2])])
    t2 = np.array([cosine(end[2]), sine(end[2])])
    way = p2 - p1
    square, along = _dot(way, way), _dot(way, t1 + t2)
    reach = square / (along + np.sqrt(along * along + 2.0 * (1.0 - _dot(t1, t2)) * square))
    joint = 0.5 * (p1 + p2 + reach * (t1 - t2))
    return [_arc(t1, joint - p1), _arc(p2 - joint, t2, ends=True)]


def _arc(one: np.ndarray, other: np.ndarray, *, ends: bool = False) -> Piece:
    """The arc that leaves along ``one`` with the chord ``other``; or that has the chord ``one`` and
    arrives along ``other``."""
    chord = one if ends else other
    square = _dot(chord, chord)
    across = float(one[0] * other[1] - one[1] * other[0])
    curvature = 2.0 * across / square
    length = float(np.sqrt(square))
    if abs(curvature) < _CURVATURE_MIN_PER_M:
        return Piece(float(settled(np.array(length))), 0.0)
    half = float(angle_of(np.array(across), np.array(_dot(one, other))))
    share = float(sine(half)) / half if half else 1.0
    return Piece(float(settled(np.array(length / share))), curvature)


def _dot(one: np.ndarray, other: np.ndarray) -> float:
    return float(one[0] * other[0] + one[1] * other[1])


def _pose(points: LanePoints, index: int) -> tuple[float, float, float]:
    return tuple(float(column[index]) for column in points)  # type: ignore[return-value]


def _end(pose: tuple[float, float, float], pieces: list[Piece]) -> tuple[float, float, float]:
    return end_of(pose, pieces)  # type: ignore[return-value]


def _merged(pieces: list[Piece]) -> list[Piece]:
    """Straights that follow one another in one piece."""
    merged = pieces[:1]
    for piece in pieces[1:]:
        if piece.curvature_per_m == merged[-1].curvature_per_m == 0.0:
            merged[-1] = Piece(merged[-1].length_m + piece.length_m, 0.0)
        else:
            merged.append(piece)
    return merged
