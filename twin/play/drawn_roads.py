"""Lanes and marks of the roads around what was played, as lines for the viewer."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from schemas.files.played_scenario import LANES_MAX, MARKS_MAX, POINTS_MAX, PlayLane, PlayMark
from twin.records.play_file import POINT_BYTES, packed_rows
from twin.road.opendrive.road_frame import RoadFrame
from twin.road.opendrive.road_map import RoadMap
from twin.road.surface.lane_strips import edge_heights
from twin.road.surface.mark_lines import painted_marks
from twin.road.surface.stations import ASIDE_M, HEIGHT_M, edge_points, section_stations
from twin.road.thinning import ERROR_M, kept_points

AROUND_M = 300.0
"""Roads farther from everything that happened are left out [m]."""
PATH_POINTS_MAX = POINTS_MAX // 4
"""Points that are left to trajectories and routes."""
_POINTS_MAX = POINTS_MAX - PATH_POINTS_MAX
_THINNED_M = ERROR_M - ASIDE_M - HEIGHT_M
_ABOVE_M = 0.006


class DrawnRoads(NamedTuple):
    """What is drawn of roads."""

    lanes: list[PlayLane]
    marks: list[PlayMark]
    notes: list[str]


Box = tuple[float, float, float, float]
"""West, south, east and north [m]."""


def drawn_roads(roads: RoadMap, box: Box) -> DrawnRoads:
    """Lanes and marks within :data:`AROUND_M` of a box, at most 5 cm from the road.

    The nearest roads come first if there are more than a file may hold.
    """
    drawn = DrawnRoads([], [], [])
    points = left_out = 0
    for away, frame in _by_distance(roads, box):
        if away > AROUND_M:
            break
        lanes, marks = list(_lanes(frame)), list(_marks(frame))
        size = sum(len(lane.left) + len(lane.right) for lane in lanes)
        size = (size + sum(len(mark.points) for mark in marks)) // POINT_BYTES
        if (
            points + size > _POINTS_MAX
            or len(drawn.lanes) + len(lanes) > LANES_MAX
            or len(drawn.marks) + len(marks) > MARKS_MAX
        ):
            left_out += 1
            continue
        points += size
        drawn.lanes.extend(lanes)
        drawn.marks.extend(marks)
    if left_out:
        drawn.notes.append(f"{left_out} roads are not drawn: they have too many points")
    return drawn


def _by_distance(roads: RoadMap, box: Box) -> list[tuple[float, RoadFrame]]:
    """Roads and their distances from a box [m], the nearest first."""
    placed = []
    for number, frame in enumerate(roads.frames.values()):
        x, y = frame.line.sample_x, frame.line.sample_y
        beside = np.maximum(np.maximum(box[0] - x, x - box[2]), 0.0)
        along = np.maximum(np.maximum(box[1] - y, y - box[3]), 0.0)
        placed.append((float(np.hypot(beside, along).min()), number, frame))
    return [(away, frame) for away, _, frame in sorted(placed, key=lambda row: row[:2])]


def _lanes(frame: RoadFrame) -> Iterator[PlayLane]:
    for number, cross in enumerate(frame.sections):
        s = section_stations(frame, number)
        inside = np.clip(s, cross.section.start_m, np.nextafter(cross.section.end_m, 0.0))
        for lane in cross.section.lanes:
            heights = edge_heights(lane, inside - cross.section.start_m)
            inner = edge_points(frame, inside, cross.inner(lane.id, inside)[0], heights[0])
            outer = edge_points(frame, inside, cross.outer(lane.id, inside)[0], heights[1])
            left, right = (outer, inner) if lane.id > 0 else (inner, outer)
            kept = kept_points(s, np.stack([left, right], axis=1), _THINNED_M)
            yield PlayLane(
                type=lane.type, left=packed_rows(left[kept]), right=packed_rows(right[kept])
            )


def _marks(frame: RoadFrame) -> Iterator[PlayMark]:
    for number, cross in enumerate(frame.sections):
        stations = section_stations(frame, number)
        for mark in painted_marks(cross.section):
            inner = stations[(stations > mark.begin_m) & (stations < mark.end_m)]
            s = np.concatenate([[mark.begin_m], inner, [mark.end_m]])
            at = np.clip(s, cross.section.start_m, np.nextafter(cross.section.end_m, 0.0))
            border = cross.outer(mark.lane, at)[0]
            height = np.zeros(len(at))
            if (lane := cross.section.lane(mark.lane)) is not None:
                height = np.maximum(edge_heights(lane, at - cross.section.start_m)[1], 0.0)
            for line in mark.lines:
                points = edge_points(frame, at, border + line.aside_m, height + _ABOVE_M)
                kept = kept_points(s, points[:, None, :], _THINNED_M)
                yield PlayMark(
                    color=line.color,
                    width_m=line.width_m,
                    stroke_m=line.stroke_m,
                    gap_m=line.gap_m,
                    from_m=line.from_m,
                    points=packed_rows(points[kept]),
                )
