"""How far the ego has come along its lane, and how far beside its centre it is."""

from __future__ import annotations

import numpy as np

from twin.road.lane import LanePath


class LaneProgress:
    """The way of one case along a lane.

    The vehicle's reference point counts, the middle of the rear axle: it is what path tracking
    controls, and the point of a car that follows a curve without being steered ahead or behind.
    """

    def __init__(self, lane: LanePath, x_m: float, y_m: float) -> None:
        self._lane = lane
        self._station_m, self.lateral_m = self._locate(x_m, y_m)
        self.distance_m = 0.0
        """Since the start; laps add up, ways back count less [m]."""

    def move(self, x_m: float, y_m: float) -> None:
        """The ego is at a new place; between two places it has driven less than half a lap."""
        station_m, self.lateral_m = self._locate(x_m, y_m)
        self.distance_m += float(self._lane.shorter_way(np.array(station_m - self._station_m)))
        self._station_m = station_m

    def _locate(self, x_m: float, y_m: float) -> tuple[float, float]:
        place = self._lane.locate(x_m, y_m)
        return float(place.s_m), float(place.lateral_m)

    @classmethod
    def along(cls, lane: LanePath, x_m: np.ndarray, y_m: np.ndarray) -> LaneProgress:
        """After the places of all rows of a case [rows], the first of which is its start."""
        found = cls(lane, float(x_m[0]), float(y_m[0]))
        places = lane.locate(x_m, y_m)
        # One after the other, as `move` adds: a pairwise sum has other last bits.
        for way_m in lane.shorter_way(np.diff(places.s_m)).tolist():
            found.distance_m += way_m
        found._station_m = float(places.s_m[-1])
        found.lateral_m = float(places.lateral_m[-1])
        return found
