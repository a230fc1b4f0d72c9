"""The lines that road marks consist of, and their strokes.

A mark of two lines names them from the inside of the road to its outside, on the centre line from
the left to the right (ASAM OpenDRIVE 1.8, table of road mark types).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from twin.road.opendrive.records import LaneSection, RoadMark

DASH_M = (3.0, 6.0)
"""Stroke and gap of a broken mark whose lines are not given [m]."""
DOTS_M = (0.12, 1.2)
"""The same of raised dots [m]."""
STROKES_MAX = 100_000
"""Most strokes of one line."""
_UNPAINTED = frozenset({"none", "curb", "grass", "edge"})
_HEAVY = {"bold": 2.0}


class PaintedLine(NamedTuple):
    """A line of a mark."""

    aside_m: float
    """Of its middle, to the left of the lane's border [m]."""
    stroke_m: float
    """0: it has no gaps [m]."""
    gap_m: float
    from_m: float
    """Where its first stroke begins, behind the mark's beginning [m]."""
    width_m: float
    color: str


class PaintedMark(NamedTuple):
    """A mark between two stations."""

    lane: int
    """On the outer border of this lane; 0: on the centre line."""
    begin_m: float
    end_m: float
    lines: tuple[PaintedLine, ...]


def painted_marks(section: LaneSection) -> Iterator[PaintedMark]:
    """The marks of a lane section that can be seen, from the left to the right."""
    for lane in (*reversed(section.left), section.center, *section.right):
        for index, mark in enumerate(lane.marks):
            begin = section.start_m + mark.start_m
            last = index + 1 == len(lane.marks)
            end = section.end_m if last else section.start_m + lane.marks[index + 1].start_m
            lines = mark_lines(mark, lane.id)
            if lines and begin < min(end, section.end_m):
                yield PaintedMark(lane.id, begin, min(end, section.end_m), lines)


def mark_lines(mark: RoadMark, lane_id: int) -> tuple[PaintedLine, ...]:
    """The lines of a mark on the outer border of a lane; none if nothing is painted."""
    if mark.lines:
        return tuple(
            PaintedLine(
                line.t_offset_m,
                line.length_m if line.space_m > 0.0 else 0.0,
                line.space_m,
                line.s_offset_m,
                line.width_m,
                line.color,
            )
            for line in mark.lines
        )
    if mark.type in _UNPAINTED:
        return ()
    width = mark.width_m * _HEAVY.get(mark.weight, 1.0)
    if mark.type == "botts dots":
        return (PaintedLine(0.0, *DOTS_M, 0.0, width, mark.color),)
    words = mark.type.split()[:2]
    inward = 1.0 if lane_id <= 0 else -1.0
    asides = (inward * width, -inward * width) if len(words) > 1 else (0.0,)
    return tuple(
        PaintedLine(aside, *(DASH_M if word == "broken" else (0.0, 0.0)), 0.0, width, mark.color)
        for aside, word in zip(asides, words, strict=True)
    )


def line_strokes(line: PaintedLine, begin_m: float, end_m: float) -> np.ndarray:
    """Where the strokes of a line begin and end, of a mark between two stations [N, 2] [m]."""
    if line.stroke_m <= 0.0:
        return np.array([(begin_m, end_m)])
    period = line.stroke_m + line.gap_m
    first = begin_m + line.from_m
    count = min(int(max(end_m - first, 0.0) / period) + 1, STROKES_MAX)
    starts = first + period * np.arange(count)
    rows = np.column_stack([starts, np.minimum(starts + line.stroke_m, end_m)])
    return rows[rows[:, 0] < rows[:, 1]]
