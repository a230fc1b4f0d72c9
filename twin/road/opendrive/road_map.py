"""All roads of a network with their coordinates: which lane is under a point, poses by road id."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twin.road.opendrive.records import RoadNetwork
from twin.road.opendrive.road_frame import RoadFrame


class LaneUnder(NamedTuple):
    """The lanes under points; arrays of one shape."""

    road: np.ndarray
    """Number of the road in the order of the file, -1 where there is none."""
    lane: np.ndarray
    """Its id, 0 where there is none."""
    s_m: np.ndarray
    t_m: np.ndarray
    h_m: np.ndarray


class RoadMap:
    """The frames of all roads.

    Raises:
        ValueError: a reference line has no direction somewhere; one line with file and road.
    """

    def __init__(self, network: RoadNetwork) -> None:
        self.network = network
        self.frames: dict[str, RoadFrame] = {}
        for road in network.roads.values():
            try:
                self.frames[road.id] = RoadFrame(road)
            except ValueError as error:
                raise ValueError(f"{network.file}: road {road.id[:40]}: {error}") from None

    def frame(self, road_id: str) -> RoadFrame:
        """The coordinates of a road.

        Raises:
            ValueError: there is no such road.
        """
        if road_id not in self.frames:
            raise ValueError(f"{self.network.file} has no road {road_id[:40]}")
        return self.frames[road_id]

    def lane_under(
        self,
        x_m: float | np.ndarray,
        y_m: float | np.ndarray,
        z_m: float | np.ndarray | None = None,
    ) -> LaneUnder:
        """The lanes under points; shapes that broadcast.

        Of several roads above one another the one nearest in height counts, then the one whose
        reference line is nearest, then the first in the file.
        """
        given = (x_m, y_m) if z_m is None else (x_m, y_m, z_m)
        arrays = [np.asarray(v, float) for v in np.broadcast_arrays(*given)]
        shape = arrays[0].shape
        points = [array.ravel() for array in arrays]
        count = len(points[0])
        best = np.full((2, count), np.inf)
        number, lane = np.full(count, -1), np.zeros(count, int)
        places = np.full((3, count), np.nan)
        for index, frame in enumerate(self.frames.values()):
            place = frame.locate(*points)
            found = frame.lane_at(place.s_m, place.t_m)
            # Beyond an end the foot is the end, and the point lies on no lane.
            back = frame.pose(place.s_m, place.t_m, place.h_m)
            off = np.hypot(back.x_m - points[0], back.y_m - points[1])
            height, beside = np.abs(place.h_m), np.abs(place.t_m)
            nearer = (height < best[0]) | ((height == best[0]) & (beside < best[1]))
            mine = (found != 0) & (off < 1e-3) & nearer
            best[:, mine] = height[mine], beside[mine]
            number[mine], lane[mine] = index, found[mine]
            places[:, mine] = np.stack(place)[:, mine]
        return LaneUnder(number.reshape(shape), lane.reshape(shape), *places.reshape((3, *shape)))
