"""Curves that actors follow from their start: pieces of clothoids become a trajectory.

A piece has a length and the curvatures at its beginning and end, between which the curvature
changes evenly along the way: a straight line, an arc, or a part of a clothoid.
"""

from __future__ import annotations

import math

import numpy as np

from twin.scenario.storyboard.compile.curves import end_of, place_on, spiral
from twin.scenario.storyboard.native.ground import SpotError
from twin.scenario.storyboard.native.ways import WAY_MAX_M, ActorWay
from twin.scenario.storyboard.program.places import FixedPosition, Trajectory, TrajectoryPiece

CURVE_PIECES_MAX = 100
"""Most pieces of a curve."""
CURVATURE_MAX_PER_M = 0.5
"""Tightest curve: no vehicle with wheels turns in less than a radius of 2 m [1/m]."""
_STEP_M = 0.5
"""Points of a way, from which crossings of ways are found [m]."""


def curve_trajectory(name: str, curve: list[list[float]], start: FixedPosition) -> Trajectory:
    """The trajectory of a curve from a place on, level with it.

    Raises:
        SpotError: a piece has no length, is too tight or too long, or there is none.
    """
    _check(curve)
    pieces: list[TrajectoryPiece] = []
    place, s_m = start, 0.0
    for length_m, begin, end in curve:
        pieces += spiral(place, (begin, end), length_m, s_m)
        place, s_m = end_of(pieces[-1]), s_m + length_m
    return Trajectory(name, False, False, tuple(pieces))


def curve_way(trajectory: Trajectory, number: int) -> ActorWay:
    """The line along a trajectory, whose index is ``number``."""
    distances: list[float] = []
    places: list[FixedPosition] = []
    for piece in trajectory.pieces:
        # The end of a piece is the beginning of the next.
        count = math.ceil(piece.length_m / _STEP_M)
        for index in range(count):
            ahead_m = piece.length_m * index / count
            distances.append(piece.start_s_m + ahead_m)
            places.append(place_on(piece, ahead_m))
    distances.append(curve_length(trajectory))
    places.append(end_of(trajectory.pieces[-1]))
    x_m, y_m = (np.array([getattr(place, name) for place in places]) for name in ("x_m", "y_m"))
    return ActorWay(np.array(distances), x_m, y_m, trajectory=number)


def curve_length(trajectory: Trajectory) -> float:
    """How long a trajectory is [m]."""
    last = trajectory.pieces[-1]
    return last.start_s_m + last.length_m


def place_after(trajectory: Trajectory, after_m: float) -> FixedPosition:
    """The place so far along a trajectory.

    Raises:
        SpotError: it is shorter.
    """
    length_m = curve_length(trajectory)
    if after_m > length_m:
        words = f"given {after_m:g} m, the curve is {length_m:g} m long"
        raise SpotError("meet_after_m", words)
    piece = next(p for p in reversed(trajectory.pieces) if p.start_s_m <= after_m)
    return place_on(piece, after_m - piece.start_s_m)


def _check(curve: list[list[float]]) -> None:
    if not 1 <= len(curve) <= CURVE_PIECES_MAX:
        words = f"given {len(curve)} pieces, allowed: 1 to {CURVE_PIECES_MAX}"
        raise SpotError("curve", f"{words}; leave curve out to follow the road")
    total_m = 0.0
    for index, piece in enumerate(curve):
        key = f"curve.{index}"
        if len(piece) != 3:
            words = "needed: length, curvature at the beginning, curvature at the end"
            raise SpotError(key, f"given {len(piece)} numbers, {words}")
        length_m, *ends = piece
        total_m += length_m
        if not 0.001 <= length_m <= WAY_MAX_M or total_m > WAY_MAX_M:
            words = f"given a length of {length_m:g} m, allowed: from 0.001"
            raise SpotError(key, f"{words}, and up to {WAY_MAX_M:g} for all pieces")
        tightest = max(ends, key=abs)
        if not abs(tightest) <= CURVATURE_MAX_PER_M:
            words = f"allowed: -{CURVATURE_MAX_PER_M:g} to {CURVATURE_MAX_PER_M:g}"
            raise SpotError(key, f"given a curvature of {tightest:g} 1/m, {words}")
