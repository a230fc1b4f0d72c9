"""Road marks as strips of triangles a little above the lanes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from twin.road.opendrive.road_frame import RoadFrame
from twin.road.surface.lane_strips import edge_heights
from twin.road.surface.mark_lines import PaintedMark, line_strokes, painted_marks
from twin.road.surface.patch import SurfacePatch, strip
from twin.road.surface.stations import edge_points

ABOVE_M = 0.006
"""How far marks lie above lanes [m]."""


def mark_strips(frame: RoadFrame, number: int, s_m: np.ndarray) -> Iterator[SurfacePatch | None]:
    """The marks of lane section ``number``; cut where the lanes are."""
    for mark in painted_marks(frame.sections[number].section):
        for line in mark.lines:
            for begin, end in line_strokes(line, mark.begin_m, mark.end_m).tolist():
                inner = s_m[(s_m > begin) & (s_m < end)]
                s = np.concatenate([[begin], inner, [end]])
                yield _stroke(frame, number, mark, s, line.aside_m, line.width_m, line.color)


def _stroke(
    frame: RoadFrame,
    number: int,
    mark: PaintedMark,
    s: np.ndarray,
    aside: float,
    width: float,
    color: str,
) -> SurfacePatch | None:
    section = frame.sections[number]
    s = np.clip(s, section.section.start_m, np.nextafter(section.section.end_m, 0.0))
    border = section.outer(mark.lane, s)[0] + aside
    lane = section.section.lane(mark.lane)
    height = np.zeros(len(s))
    if lane is not None:
        # Half of a mark lies on the lane outside; the higher of the two carries it.
        height = np.maximum(edge_heights(lane, s - section.section.start_m)[1], 0.0)
    left = edge_points(frame, s, border + 0.5 * width, height + ABOVE_M)
    right = edge_points(frame, s, border - 0.5 * width, height + ABOVE_M)
    return strip("mark", color, left, right)
