"""Lanes as strips of triangles, with kerbs where neighbours differ in height."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from twin.road.opendrive.records import Lane
from twin.road.opendrive.road_frame import RoadFrame, lane_heights
from twin.road.surface.patch import SurfacePatch, strip
from twin.road.surface.stations import edge_points

KERB_M = 0.005
"""Least step between lanes that gets a kerb [m]."""
SLOPE_M = (5.0, 3.0)
"""How far a slope beside a road goes out and down [m]."""
LOWERED_M = 0.01
"""How far lanes of no use lie below the others: where roads of a junction overlap they give way."""
_LOWERED = frozenset({"none"})


def lane_strips(frame: RoadFrame, number: int, s_m: np.ndarray) -> Iterator[SurfacePatch | None]:
    """The lanes of lane section ``number``, cut at stations; kerbs between them."""
    section = frame.sections[number]
    inside = np.clip(s_m, section.section.start_m, np.nextafter(section.section.end_m, 0.0))
    borders = section.borders(inside)
    for sign, lanes in ((1.0, section.section.left), (-1.0, section.section.right)):
        rim, t = edge_points(frame, inside, borders[0]), borders[0]
        lift = np.zeros(len(inside))
        for lane in lanes:
            heights = edge_heights(lane, inside - section.section.start_m)
            inner = edge_points(frame, inside, t, heights[0])
            t = borders[lane.id]
            outer = edge_points(frame, inside, t, heights[1])
            sides = (outer, inner) if sign > 0.0 else (inner, outer)
            for friction, pieces in _frictions(lane, inside - section.section.start_m):
                yield strip("lane", lane.type, *sides, pieces, friction)
            if (np.abs(heights[0] - lift) > KERB_M).any():
                low_first = rim if sign > 0.0 else inner
                yield strip("kerb", "", inner if sign > 0.0 else rim, low_first)
            rim, lift = outer, heights[1]


def _frictions(lane: Lane, ahead_m: np.ndarray) -> Iterator[tuple[float | None, np.ndarray | None]]:
    """The frictions of a lane, and the pieces between stations that have each."""
    if not lane.materials:
        yield None, None
        return
    middle = 0.5 * (ahead_m[:-1] + ahead_m[1:])
    starts = np.array([material.start_m for material in lane.materials])
    record = np.searchsorted(starts, middle, "right") - 1
    for index in np.unique(record).tolist():
        friction = lane.materials[index].friction if index >= 0 else None
        yield friction, record == index


def side_slopes(frame: RoadFrame, number: int, s_m: np.ndarray) -> Iterator[SurfacePatch | None]:
    """The slopes that carry the outermost lanes of a section, down to below the ground around."""
    section = frame.sections[number]
    inside = np.clip(s_m, section.section.start_m, np.nextafter(section.section.end_m, 0.0))
    for sign, lanes in ((1.0, section.section.left), (-1.0, section.section.right)):
        height = np.zeros(len(inside))
        if lanes:
            height = edge_heights(lanes[-1], inside - section.section.start_m)[1]
        t = section.outer(lanes[-1].id if lanes else 0, inside)[0]
        rim = edge_points(frame, inside, t, height)
        inner = edge_points(frame, inside, t - sign * 0.1, height)
        out = rim[:, :2] - inner[:, :2]
        out /= np.maximum(np.hypot(out[:, :1], out[:, 1:]), 1e-9)
        foot = np.column_stack([rim[:, :2] + SLOPE_M[0] * out, rim[:, 2] - SLOPE_M[1]])
        yield strip("ground", "", *((foot, rim) if sign > 0.0 else (rim, foot)))


def edge_heights(lane: Lane, ahead_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Heights above the road of a lane's inner and outer border, by way since the section begins
    [m]."""
    lowered = LOWERED_M if lane.type in _LOWERED else 0.0
    inner, outer = lane_heights(lane, ahead_m)
    return inner - lowered, outer - lowered
