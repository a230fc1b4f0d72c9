"""The road functions of kernels on arrays, for tests."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import warp as wp

from twin.road.tables.road_tables import RoadTables
from twin.road.walk.distances import road_apart
from twin.road.walk.lanes import (
    lane_at,
    lane_beside,
    lane_centre,
    lane_count,
    lane_driven,
    lane_exists,
    lane_sign,
    lane_type,
    lane_width,
)
from twin.road.walk.locating import road_locate
from twin.road.walk.moves import move_across, move_at, move_on_lane, road_advance
from twin.road.walk.poses import pose_along, road_pose
from twin.road.walk.road_arrays import RoadArrays, road_arrays
from twin.road.walk.spots import road_curvature, road_length

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

ANY_LANE = -99
"""In ``advance``: the lane is the one in which t lies."""


@wp.kernel
def pose_kernel(
    roads: RoadArrays,
    places: wp.array2d(dtype=wp.float64),
    along: wp.int32,
    rows: wp.array2d(dtype=wp.float64),
):
    """Poses at road, s, t, slope."""
    i = wp.tid()
    road = wp.int32(places[i, 0])
    s, t = places[i, 1], places[i, 2]
    point = road_pose(roads, road, s, t)
    if along == 1:
        point = pose_along(roads, road, s, t, places[i, 3], True)
    rows[i, 0] = point.x
    rows[i, 1] = point.y
    rows[i, 2] = point.z
    rows[i, 3] = point.heading
    rows[i, 4] = point.pitch
    rows[i, 5] = point.roll
    rows[i, 6] = point.curvature
    rows[i, 7] = point.climb


@wp.kernel
def lane_kernel(
    roads: RoadArrays,
    places: wp.array2d(dtype=wp.float64),
    rows: wp.array2d(dtype=wp.float64),
):
    """All about the lane at road, s, t, lane, steps."""
    i = wp.tid()
    road = wp.int32(places[i, 0])
    s, t = places[i, 1], places[i, 2]
    lane, steps = wp.int32(places[i, 3]), wp.int32(places[i, 4])
    middle = lane_centre(roads, road, lane, s)
    count = lane_count(roads, road, s)
    rows[i, 0] = middle[0]
    rows[i, 1] = middle[1]
    rows[i, 2] = lane_width(roads, road, lane, s)
    rows[i, 3] = wp.float64(lane_at(roads, road, s, t))
    rows[i, 4] = wp.where(lane_exists(roads, road, lane, s), wp.float64(1.0), wp.float64(0.0))
    rows[i, 5] = wp.float64(lane_sign(roads, road, lane, s))
    rows[i, 6] = wp.float64(lane_type(roads, road, lane, s))
    rows[i, 7] = wp.float64(lane_beside(roads, road, s, lane, steps))
    rows[i, 8] = wp.float64(count[0])
    rows[i, 9] = wp.float64(count[1])
    rows[i, 10] = road_length(roads, road)
    rows[i, 11] = road_curvature(roads, road, s)
    rows[i, 12] = wp.where(lane_driven(roads, road, lane, s), wp.float64(1.0), wp.float64(0.0))


@wp.kernel
def advance_kernel(
    roads: RoadArrays,
    route: wp.array(dtype=wp.int32),
    starts: wp.array2d(dtype=wp.float64),
    distances: wp.array2d(dtype=wp.float64),
    rows: wp.array2d(dtype=wp.float64),
):
    """Places after some distances from road, lane, s, offset (or t), sign, route_at."""
    i = wp.tid()
    road, lane = wp.int32(starts[i, 0]), wp.int32(starts[i, 1])
    s, offset, sign = starts[i, 2], starts[i, 3], wp.int32(starts[i, 4])
    move = move_on_lane(roads, road, lane, s, offset, sign)
    if lane == -99:
        move = move_at(roads, road, s, offset, sign)
    move.route_at = wp.int32(starts[i, 5])
    span = wp.vec2i(0, 0)
    if move.route_at >= 0:
        span = wp.vec2i(0, route.shape[0])
    for k in range(distances.shape[1]):
        move = road_advance(roads, route, span, move, distances[i, k])
    rows[i, 0] = wp.float64(move.road)
    rows[i, 1] = wp.float64(move.lane)
    rows[i, 2] = move.s
    rows[i, 3] = move.offset
    rows[i, 4] = move.t
    rows[i, 5] = wp.float64(move.sign)
    rows[i, 6] = wp.float64(move.at_end)
    rows[i, 7] = move.rest
    rows[i, 8] = wp.float64(move.route_at)
    rows[i, 9] = move.slope


@wp.kernel
def across_kernel(
    roads: RoadArrays,
    places: wp.array2d(dtype=wp.float64),
    rows: wp.array2d(dtype=wp.float64),
):
    """From road, lane, s, sign to t."""
    i = wp.tid()
    move = move_on_lane(
        roads,
        wp.int32(places[i, 0]),
        wp.int32(places[i, 1]),
        places[i, 2],
        wp.float64(0.0),
        wp.int32(places[i, 3]),
    )
    move.route_at = 7
    move = move_across(roads, move, places[i, 4])
    rows[i, 0] = wp.float64(move.lane)
    rows[i, 1] = move.offset
    rows[i, 2] = move.t
    rows[i, 3] = wp.float64(move.sign)
    rows[i, 4] = wp.float64(move.route_at)
    rows[i, 5] = move.s


@wp.kernel
def locate_kernel(
    roads: RoadArrays,
    points: wp.array2d(dtype=wp.float64),
    rows: wp.array2d(dtype=wp.float64),
):
    """Places of x, y, z, near_road, near_s."""
    i = wp.tid()
    spot = road_locate(
        roads, points[i, 0], points[i, 1], points[i, 2], wp.int32(points[i, 3]), points[i, 4]
    )
    rows[i, 0] = wp.float64(spot.road)
    rows[i, 1] = wp.float64(spot.lane)
    rows[i, 2] = spot.s
    rows[i, 3] = spot.t
    rows[i, 4] = spot.h
    rows[i, 5] = spot.past


@wp.kernel
def apart_kernel(
    roads: RoadArrays,
    pairs: wp.array2d(dtype=wp.float64),
    rows: wp.array2d(dtype=wp.float64),
):
    """How far road, s, t are from each other."""
    i = wp.tid()
    apart = road_apart(
        roads,
        wp.int32(pairs[i, 0]),
        pairs[i, 1],
        pairs[i, 2],
        wp.int32(pairs[i, 3]),
        pairs[i, 4],
        pairs[i, 5],
    )
    rows[i, 0] = wp.float64(apart.reached)
    rows[i, 1] = apart.ds
    rows[i, 2] = apart.dt
    rows[i, 3] = wp.float64(apart.sign)


class Moved(NamedTuple):
    """Columns of ``advance``."""

    road: np.ndarray
    lane: np.ndarray
    s: np.ndarray
    offset: np.ndarray
    t: np.ndarray
    sign: np.ndarray
    at_end: np.ndarray
    rest: np.ndarray
    route_at: np.ndarray
    slope: np.ndarray


class Walks:
    """The functions over one network; arguments broadcast, results have rows."""

    def __init__(self, tables: RoadTables, device: str = "cpu") -> None:
        self.tables = tables
        self.device = wp.get_device(device)
        self.roads = road_arrays(tables, self.device)

    def pose(self, road: Any, s: Any, t: Any, slope: Any = None) -> np.ndarray:
        """x, y, z, heading, pitch, roll, curvature, climb [N, 8]; ``slope``: along it."""
        places = _rows(road, s, t, 0.0 if slope is None else slope)
        return self._run(pose_kernel, 8, places, int(slope is not None))

    def lanes(self, road: Any, s: Any, t: Any = 0.0, lane: Any = 0, steps: Any = 0) -> np.ndarray:
        """As ``lane_kernel`` [N, 13]."""
        return self._run(lane_kernel, 13, _rows(road, s, t, lane, steps))

    def advance(
        self,
        road: Any,
        lane: Any,
        s: Any,
        offset: Any,
        sign: Any,
        *distances: Any,
        route: list[int] | None = None,
        route_at: int = 0,
    ) -> Moved:
        """Places after all of the distances one after another."""
        columns = _rows(road, lane, s, offset, sign, -1 if route is None else route_at, *distances)
        starts, steps = np.ascontiguousarray(columns[:, :6]), np.ascontiguousarray(columns[:, 6:])
        ways = wp.array(np.array(route or [0], np.int32), device=self.device)
        rows = wp.zeros((len(starts), 10), dtype=wp.float64, device=self.device)
        arrays = [wp.array(v, dtype=wp.float64, device=self.device) for v in (starts, steps)]
        wp.launch(
            advance_kernel, len(starts), [self.roads, ways, *arrays], [rows], device=self.device
        )
        return Moved(*rows.numpy().T)

    def across(self, road: Any, lane: Any, s: Any, sign: Any, t: Any) -> np.ndarray:
        """lane, offset, t, sign, route_at, s [N, 6]."""
        return self._run(across_kernel, 6, _rows(road, lane, s, sign, t))

    def locate(self, x: Any, y: Any, z: Any, near_road: Any = -1, near_s: Any = 0.0) -> np.ndarray:
        """road, lane, s, t, h, past [N, 6]."""
        return self._run(locate_kernel, 6, _rows(x, y, z, near_road, near_s))

    def apart(self, road: Any, s: Any, t: Any, to_road: Any, to_s: Any, to_t: Any) -> np.ndarray:
        """reached, ds, dt, sign [N, 4]."""
        return self._run(apart_kernel, 4, _rows(road, s, t, to_road, to_s, to_t))

    def _run(self, kernel: Any, columns: int, places: np.ndarray, *more: Any) -> np.ndarray:
        rows = wp.zeros((len(places), columns), dtype=wp.float64, device=self.device)
        array = wp.array(places, dtype=wp.float64, device=self.device)
        wp.launch(kernel, len(places), [self.roads, array, *more], [rows], device=self.device)
        return rows.numpy()


def _rows(*columns: Any) -> np.ndarray:
    arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, float)) for v in columns))
    return np.ascontiguousarray(np.column_stack(arrays))
