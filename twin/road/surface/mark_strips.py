"""Road marks as strips of triangles a little above the lanes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from twin.road.opendrive.road_frame import RoadFrame
from twin.road.surface.lane_strips import edge_heights
from twin.road.surface.mark_lines import PaintedLine, PaintedMark, line_strokes, painted_marks
from twin.road.surface.patch import SurfacePatch, strip
from twin.road.surface.stations import edge_points

ABOVE_M = 0.006
"""How far marks lie above lanes [m]."""


def mark_strips(frame: RoadFrame, number: int, s_m: np.ndarray) -> Iterator[SurfacePatch | None]:
    """The marks of lane section ``number``; cut where the lanes are."""
    for mark in painted_marks(frame.sections[number].section):
        for line in mark.lines:
            strokes = line_strokes(line, mark.begin_m, mark.end_m)
            if len(strokes):
                yield _painted(frame, number, mark, line, *_cut(strokes, s_m))


def _cut(strokes: np.ndarray, s_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stations of strokes [N, 2], ends and cuts, and which of them are joined to the next."""
    begins, ends = strokes.T
    stroke = np.searchsorted(begins, s_m, "right") - 1
    inner = (stroke >= 0) & (s_m > begins[stroke]) & (s_m < ends[stroke])
    s = np.concatenate([begins, s_m[inner], ends])
    number = np.concatenate([np.arange(len(begins)), stroke[inner], np.arange(len(begins))])
    order = np.lexsort((s, number))
    return s[order], np.diff(number[order]) == 0


def _painted(
    frame: RoadFrame,
    number: int,
    mark: PaintedMark,
    line: PaintedLine,
    s: np.ndarray,
    joined: np.ndarray,
) -> SurfacePatch | None:
    section = frame.sections[number]
    s = np.clip(s, section.section.start_m, np.nextafter(section.section.end_m, 0.0))
    border = section.outer(mark.lane, s)[0] + line.aside_m
    lane = section.section.lane(mark.lane)
    height = np.zeros(len(s))
    if lane is not None:
        # Half of a mark lies on the lane outside; the higher of the two carries it.
        height = np.maximum(edge_heights(lane, s - section.section.start_m)[1], 0.0)
    half = 0.5 * line.width_m
    left = edge_points(frame, s, border + half, height + ABOVE_M)
    right = edge_points(frame, s, border - half, height + ABOVE_M)
    return strip("mark", line.color, left, right, joined)
