"""Roads that bend: the segments of a scene file, and the closed lane they make."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from msgspec import Meta

from twin.road.lane import LanePath, Piece, end_of, trace
from twin.world.spec import Length, Spec

SEGMENTS_MAX = 64
"""Most segments of a road."""
LENGTH_MAX_M = 5000.0
"""Longest road [m]."""

_OPEN_M, _OPEN_DEG = 0.01, 0.01
"""What the ends of a road may be apart: less than the width of a line [m], [deg]."""
_STEP_M = 1.0
_SLACK_M = 0.05


class Arc(Spec):
    """A curve."""

    radius_m: Length
    """Radius of the lane's centre [m]."""
    turn_deg: Annotated[float, Meta(ge=-350, le=350)]
    """Turn, to the left positive [deg]."""


class Segment(Spec, kw_only=True):
    """A piece of a road: a straight one or a curve."""

    line_m: Length | None = None
    """Length of a straight [m]."""
    arc: Arc | None = None

    def __post_init__(self) -> None:
        if (self.line_m is None) == (self.arc is None):
            raise ValueError("give one of line_m and arc")
        if self.arc is not None and abs(self.arc.turn_deg) < 1.0:
            raise ValueError(
                f"arc.turn_deg {self.arc.turn_deg:g}: at least 1 degree; else give line_m"
            )

    def piece(self) -> Piece:
        """Length and curvature of the piece."""
        if self.arc is None:
            return Piece(self.line_m or 0.0, 0.0)
        radius, turn = self.arc.radius_m, math.radians(self.arc.turn_deg)
        return Piece(radius * abs(turn), math.copysign(1.0 / radius, turn))


def closed_lane(start_x_m: float, segments: list[Segment], half_width_m: float) -> LanePath:
    """The lane of a closed road that begins at ``start_x_m`` on the x axis, towards +x.

    Args:
        half_width_m: from the lane's centre to the farther wall behind the sidewalks; nothing of
            the road may come as near as this to another part of it.

    Raises:
        ValueError: the road does not close, is too long, bends too tightly or meets itself; one
            line.
    """
    for number, segment in enumerate(segments):
        if segment.arc is not None and segment.arc.radius_m < half_width_m:
            raise ValueError(
                f"path[{number}].arc.radius_m {segment.arc.radius_m:g}: tighter than the road's "
                f"half width, {half_width_m:g} m from the lane's centre to the wall; widen the arc"
            )
    start = (start_x_m, 0.0, 0.0)
    pieces = [segment.piece() for segment in segments]
    length = sum(piece.length_m for piece in pieces)
    if length > LENGTH_MAX_M:
        raise ValueError(f"path: {length:.0f} m long, allowed: at most {LENGTH_MAX_M:g} m")
    x, y, heading = end_of(start, pieces)
    turn_deg = math.degrees(heading)
    if abs(abs(turn_deg) - 360.0) > _OPEN_DEG:
        raise ValueError(
            f"path: turns by {turn_deg:.6g} degrees in all, needed: 360 or -360, once round; "
            "change turn_deg of its arcs"
        )
    if math.hypot(x - start_x_m, y) > _OPEN_M:
        raise ValueError(
            f"path: ends at x {round(x, 3):g}, y {round(y, 3) + 0.0:g}, needed: its start at "
            f"x {start_x_m:g}, y 0; change line_m of its straights"
        )
    lane = trace(start, pieces, closed=True)
    _refuse_meeting(lane, half_width_m)
    return lane


def _refuse_meeting(lane: LanePath, half_width_m: float) -> None:
    """Beside a lane that keeps clear of itself, every place within reach is nearest to its own
    station."""
    s = np.arange(0.0, lane.length_m, _STEP_M)
    for side in (half_width_m, -half_width_m):
        beside = lane.at(s, side)
        near = np.abs(lane.locate(beside.x_m, beside.y_m).lateral_m)
        if (near < half_width_m - _SLACK_M).any():
            at = float(s[np.argmax(near < half_width_m - _SLACK_M)])
            raise ValueError(
                f"path: the road meets itself about {at:.0f} m from its start; its parts need "
                f"{2 * half_width_m:g} m between the centres of their lanes"
            )
