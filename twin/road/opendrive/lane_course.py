"""The course of a lane: its middle from where it is driven in to where it ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.road.opendrive.grid import cosine, sine, turned
from twin.road.opendrive.lane_graph import DrivenLane, LaneGraph
from twin.road.opendrive.records import DRIVEN_TYPES
from twin.road.opendrive.road_map import RoadMap

COURSE_MAX_M = 100_000
"""How far a lane is followed [m]."""
STRETCHES_MAX = 10_000
"""Lanes of sections that one course follows."""
WIDTH_MIN_M = 2.0
"""Where it is narrower a lane ends [m]."""
GAP_MAX_M = 0.05
"""Where the next lane begins farther away a lane ends [m]."""
KINK_MAX_RAD = math.radians(3.0)
"""Where the next lane turns off by more a lane ends."""
APART_MIN_M = 4.0
"""Where a lane comes so near to an earlier part of itself it ends, in plan: on a bridge over itself
the nearest part would be ambiguous [m]."""
_SELF_M = 40.0
"""Parts of a lane that are so far apart along it are earlier and later ones [m]."""
_STEP_M = 1.0
_STEP_MIN_M = 0.001


@dataclass(frozen=True, slots=True)
class LaneCourse:
    """Places along the middle of a lane, arrays [P], at most a metre apart."""

    x_m: np.ndarray
    y_m: np.ndarray
    z_m: np.ndarray
    heading_rad: np.ndarray
    """Heading as the lane is driven [rad]."""
    width_m: np.ndarray
    """Width of the lane."""
    closed: bool
    """It leads back to its beginning, which is the last place, too."""


def lane_course(roads: RoadMap, graph: LaneGraph, first: DrivenLane) -> LaneCourse:
    """The course of a lane and of those that it leads to, at forks the one that turns least.

    It ends where no lane follows, where a lane is too narrow or does not continue the one before,
    where it comes near to itself, and at its limits.

    Args:
        roads: coordinates of the network.
        graph: its lanes.
        first: where the course begins.
    """
    rows: list[np.ndarray] = []
    lane, length, closed = first, 0.0, False
    followed: set[DrivenLane] = set()
    while lane not in followed and len(followed) < STRETCHES_MAX:
        followed.add(lane)
        stretch, whole = _stretch(roads, lane, COURSE_MAX_M - length)
        if rows and not _continues(rows[-1], stretch):
            break
        length += float(_ways(stretch)[-1])
        rows.append(stretch[:, 1:] if rows else stretch)
        after = [one for one in graph.successors(lane) if _driven(roads, one)]
        if not whole or not after:
            break
        lane = min(after, key=lambda one: abs(_bend_rad(roads, one)))
        if lane == first:
            closed = _continues(rows[-1], rows[0])
            break
    course = np.concatenate(rows, axis=1)
    course = course[:, np.append(True, np.diff(_ways(course)) > _STEP_MIN_M)]
    if closed:
        course[:, -1] = course[:, 0]
    end = min(_folds(course), _meets_itself(course, closed))
    if end < course.shape[1]:
        course, closed = course[:, :end], False
    x, y, z, heading, width = course
    return LaneCourse(x, y, z, heading, width, closed)


def _stretch(roads: RoadMap, driven: DrivenLane, length_max_m: float) -> tuple[np.ndarray, bool]:
    """Places of a lane of one section [5, P], and whether they reach its end: it may be longer than
    there is room for, or too narrow."""
    key, sign = driven
    frame = roads.frames[key.road]
    section = frame.sections[key.section].section
    # Stations of a section's end belong to the next one.
    low, high = section.start_m, float(np.nextafter(section.end_m, -np.inf))
    room_m = max(length_max_m, _STEP_M)
    whole = high - low <= room_m
    if not whole:
        low, high = (low, low + room_m) if sign > 0 else (high - room_m, high)
    count = max(2, math.ceil((high - low) / _STEP_M) + 1)
    s = np.linspace(low, max(high, low), count)[::sign]
    pose = frame.lane_pose(key.lane, s)
    heading = pose.heading_rad if sign > 0 else turned(pose.heading_rad + np.pi)
    width = frame.lane_width(key.lane, s)
    rows = np.stack([pose.x_m, pose.y_m, pose.z_m, heading, width])
    narrow = np.flatnonzero(width < WIDTH_MIN_M)
    if not len(narrow):
        return rows, whole
    return rows[:, : max(2, int(narrow[0]))], False


def _continues(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether a stretch begins where another ends."""
    gap = after[:3, 0] - before[:3, -1]
    kink = math.remainder(float(after[3, 0] - before[3, -1]), 2.0 * math.pi)
    return float(np.sqrt((gap * gap).sum())) <= GAP_MAX_M and abs(kink) <= KINK_MAX_RAD


def _driven(roads: RoadMap, driven: DrivenLane) -> bool:
    section = roads.network.roads[driven.key.road].sections[driven.key.section]
    lane = section.lane(driven.key.lane)
    return lane is not None and lane.type in DRIVEN_TYPES


def _bend_rad(roads: RoadMap, driven: DrivenLane) -> float:
    """By how much the heading changes along the road of a lane."""
    frame = roads.frames[driven.key.road]
    ends: Sequence[float] = frame.pose(np.array([0.0, frame.road.length_m])).heading_rad.tolist()
    return math.remainder(ends[1] - ends[0], 2.0 * math.pi)


def _ways(rows: np.ndarray) -> np.ndarray:
    """Way from the first place to each, in plan [P] [m]."""
    steps = np.diff(rows[:2], axis=1)
    ways: np.ndarray = np.append(0.0, np.cumsum(np.sqrt((steps * steps).sum(axis=0))))
    return ways


def _folds(rows: np.ndarray) -> int:
    """How many places come before the first that does not lie ahead; all if none does."""
    steps, heading = np.diff(rows[:2], axis=1), rows[3, :-1]
    ahead = steps[0] * cosine(heading) + steps[1] * sine(heading)
    back = np.flatnonzero(ahead <= 0.0)
    return int(back[0]) + 1 if len(back) else rows.shape[1]


def _meets_itself(rows: np.ndarray, closed: bool) -> int:
    """How many places come before the first that is near to an earlier part; all if none is."""
    ways = _ways(rows)
    cells: dict[tuple[int, int], list[int]] = {}
    places = np.floor(rows[:2] / APART_MIN_M).astype(int).T.tolist()
    for index, (column, row) in enumerate(places):
        if closed and ways[-1] - ways[index] < _SELF_M:
            break
        near = [
            other
            for c in (column - 1, column, column + 1)
            for r in (row - 1, row, row + 1)
            for other in cells.get((c, r), ())
            if ways[index] - ways[other] > _SELF_M
        ]
        if near:
            gaps = rows[:2, near] - rows[:2, index : index + 1]
            if float((gaps * gaps).sum(axis=0).min()) < APART_MIN_M * APART_MIN_M:
                return index
        cells.setdefault((column, row), []).append(index)
    return int(rows.shape[1])
