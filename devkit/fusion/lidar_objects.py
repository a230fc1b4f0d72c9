"""Obstacles in a LiDAR sweep: ground taken away, cells counted, neighbours joined.

One slot at a time and sums along one axis only, so neighbours in the rig change no bit. Nothing
here looks at the kind of a return: a real sensor does not know it. Fog, drops and flakes are told
from surfaces by how thinly they fill the space.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from devkit.fusion.lidar_points import (
    CELL_M,
    HALF_WIDTH_M,
    NEAR_M,
    LidarView,
    X,
    ground,
    in_vehicle_axes,
)
from devkit.fusion.path import CarPath

ROAD_HALF_M = 9.0
"""Half width of what is looked at along the road [m]."""
BESIDE_POINTS_MIN = 3
"""Fewest points of what is beside the road: a motorcycle has no more at 40 m, and what is there has
to be seen again and again [-]."""
COMPACT_M = 6.5
"""What reaches further, along or across, is no car or motorcycle that crosses [m]."""
CROSSING_S, CROSSING_MIN_M = 2.6, 8.0
"""Who crosses is looked for where the car will be within this time, at least so far ahead
[s, m]."""
CROSSING_MAX_MPS = 25.0
"""Fastest who crosses: what is further aside than he goes until the car is there does not matter
[m/s]."""
LOW_M, HIGH_M = 0.3, 2.2
"""Height of obstacles above the ground: above kerbs, below what a car drives under [m]."""
FILL_MIN = 0.15
"""Share of the rays through a cell's front, 1.2 m high, that must come back from it [-]."""
EDGE_POINTS = 2
"""Outermost points of an obstacle that are not its edge: mixed pixels."""


class SweepObjects(NamedTuple):
    """Obstacles of one sweep, the nearest first and those along the road before those beside it, in
    arrays [M]."""

    x_m: np.ndarray
    """Near end."""
    right_m: np.ndarray
    left_m: np.ndarray
    inside: np.ndarray
    """bool: enough points are in the path."""
    path_x_m: np.ndarray
    """Nearest part in the path; ``x_m`` where it is outside."""
    beside: np.ndarray
    """bool: further aside than :data:`ROAD_HALF_M`; these stand last."""
    reach_m: float
    """The furthest one along the road; 0: there is none."""
    free_to_m: float
    """The road in the path is seen up to here [m]."""
    returned: float
    """Share of the rays that came back, of all around the car [-]."""


def find_objects(
    points: np.ndarray,
    view: LidarView,
    *,
    speed_mps: float,
    path: CarPath,
    corridor_half_m: float,
    range_m: float,
    points_min: int,
    deskewed: bool,
) -> SweepObjects:
    """Obstacles of one sweep.

    Args:
        points: float32 [N, K], :data:`schemas.sections.lidar.POINT_COLUMNS`.
        view: of the LiDAR.
        speed_mps: of the ego.
        path: of the ego.
        corridor_half_m: half width of the path.
        range_m: points further ahead are left out.
        points_min: fewest points of an obstacle.
        deskewed: whether the points are those of the tick already.
    """
    returned = float(np.count_nonzero(np.isfinite(points[:, X]))) / max(len(points), 1)
    x, y, z = in_vehicle_axes(points, view, speed_mps, range_m, deskewed=deskewed)
    road = np.flatnonzero(np.abs(y) < ROAD_HALF_M)
    lowest_m, slope = ground(x.take(road), z.take(road))
    height = z - (lowest_m + slope * x)
    low = np.flatnonzero(np.abs(height) < LOW_M)
    far, aside = x.take(low), y.take(low)
    ways = far[np.abs(path.beside_arc_m(far, aside)) < corridor_half_m]
    free_to_m = float(np.partition(ways, -5)[-5]) if len(ways) >= 5 else 0.0
    high = np.flatnonzero((height > LOW_M) & (height < HIGH_M))
    x, y = x.take(high), y.take(high)
    group = _groups(x, y, view, range_m)
    inside = path.holds(x, y, y, corridor_half_m)
    rows = _obstacles(x, y, inside, group, speed_mps, points_min)
    rows.sort()
    beside, near, right, left, reaches, way = (
        np.array([row[i] for row in rows], bool if i in (0, 4) else float) for i in range(6)
    )
    along = near[~beside]
    reach_m = float(along[-1]) if len(along) else 0.0
    return SweepObjects(near, right, left, reaches, way, beside, reach_m, free_to_m, returned)


def _obstacles(
    x: np.ndarray,
    y: np.ndarray,
    inside: np.ndarray,
    group: np.ndarray,
    speed_mps: float,
    points_min: int,
) -> list[tuple[bool, float, float, float, bool, float]]:
    """Obstacles among the groups of points: of each, whether it is beside the road, its near end,
    right and left end, whether it is in the path, and its nearest part there."""
    groups = int(group.max(initial=0))
    if not groups:
        return []
    # Numbers of two bytes are sorted by counting, in the order of the points.
    order = np.argsort(group.astype(np.uint16), kind="stable")
    order = order[len(group) - np.count_nonzero(group) :]
    x, y, inside = x[order], y[order], inside[order]
    bounds = np.searchsorted(group[order], np.arange(1, groups + 2))
    starts = bounds[:-1]
    into = np.add.reduceat(inside, starts, dtype=np.int64).tolist()
    long_m = np.maximum(_reach(x, starts), _reach(y, starts)).tolist()
    rows = []
    bounds = bounds.tolist()
    for index, (first, last) in enumerate(pairwise(bounds)):
        if last - first < BESIDE_POINTS_MIN:
            continue
        xs, ys, within = x[first:last], y[first:last], inside[first:last]
        if long_m[index] > COMPACT_M:
            road = np.abs(ys) < ROAD_HALF_M
            xs, ys, within = xs[road], ys[road], within[road]
            if len(xs) < points_min:
                continue
        count = int(np.count_nonzero(within)) if into[index] else 0
        within = np.sort(xs[within]) if count >= points_min else within
        xs.sort()
        ys.sort()
        skip = EDGE_POINTS if len(xs) > 4 * EDGE_POINTS else 0
        near_m, right_m, left_m = float(xs[skip]), float(ys[skip]), float(ys[-1 - skip])
        beside_m = max(right_m, -left_m)
        beside = beside_m > ROAD_HALF_M
        if len(xs) < points_min and not beside:
            continue
        if beside and not _may_cross(near_m, beside_m, speed_mps):
            continue
        path_m = float(within[min(skip, count - 1)]) if count >= points_min else near_m
        rows.append((beside, near_m, right_m, left_m, count >= points_min, path_m))
    return rows


def _reach(values: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Largest difference within each group of values; ``starts``: where groups begin."""
    most: np.ndarray = np.maximum.reduceat(values, starts)
    return most - np.minimum.reduceat(values, starts)


def _may_cross(x_m: float, beside_m: float, speed_mps: float) -> bool:
    """Whether what is so far aside could be in the path when the car is there, soon."""
    soon_m = max(CROSSING_S * speed_mps, CROSSING_MIN_M)
    return beside_m / CROSSING_MAX_MPS * speed_mps < x_m - NEAR_M < soon_m


def _groups(x: np.ndarray, y: np.ndarray, view: LidarView, range_m: float) -> np.ndarray:
    """Group of each point, from 1; 0: in a cell too thin to be a surface."""
    rows = math.ceil(range_m / CELL_M)
    columns = math.ceil(2.0 * HALF_WIDTH_M / CELL_M)
    row = np.minimum((x / CELL_M).astype(np.int64), rows - 1)
    column = np.minimum(((y + HALF_WIDTH_M) / CELL_M).astype(np.int64), columns - 1)
    cell = row * columns + column
    count = np.bincount(cell, minlength=rows * columns).reshape(rows, columns)
    group: np.ndarray = joined(count > _least_points(view, rows, columns)).reshape(-1)[cell]
    return group


@lru_cache(maxsize=16)
def _least_points(view: LidarView, rows: int, columns: int) -> np.ndarray:
    """More points than this make a cell solid, [rows, columns]; not to be written to."""
    ahead = np.maximum((np.arange(rows) + 0.5) * CELL_M - view.position_m[0], 1.0)
    aside = np.abs((np.arange(columns) + 0.5) * CELL_M - HALF_WIDTH_M)
    beside = aside > ROAD_HALF_M
    aside = np.where(beside, aside, 0.0)
    square = (ahead * ahead)[:, None] + aside * aside
    least: np.ndarray = np.maximum(
        FILL_MIN * view.rays_in_cell / square, np.where(beside, 0.5, 1.5)
    )
    return least


def joined(solid: np.ndarray) -> np.ndarray:
    """Group of each cell, int64 [rows, columns]: 0 where it is not ``solid``, else from 1, the same
    for cells that touch along a side or at a corner.

    Every cell takes the least number around it, then that of the cell with this number, until
    nothing changes: some ten rounds.
    """
    wide = np.pad(solid, 1)  # so that every cell has eight around it
    cells = np.flatnonzero(wide)
    place = np.full(wide.size, len(cells))
    place[cells] = np.arange(len(cells))
    below = wide.shape[1]
    steps = np.array([-below - 1, -below, 1 - below, -1, 1, below - 1, below, below + 1])
    around = place[cells + steps[:, None]]
    number = np.arange(len(cells) + 1)  # the last stands for cells that are not solid
    while True:
        least = np.minimum(number[:-1], number[around].min(axis=0))
        least = least[least]
        if np.array_equal(least, number[:-1]):
            break
        number[:-1] = least
    group = np.zeros(solid.shape, np.int64)
    group[solid] = np.unique(number[:-1], return_inverse=True)[1] + 1
    return group
