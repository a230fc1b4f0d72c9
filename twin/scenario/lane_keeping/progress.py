"""Progress of an ego along its lane: how far it has come, and how far beside the centre it is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.road.lane import LanePath


class LaneProgress:
    """The distance of one case along a lane.

    The vehicle's reference point counts, the middle of the rear axle: it is what path tracking
    controls, and the point of a car that follows a curve without being steered ahead or behind.
    """

    def __init__(self, lane: LanePath, x_m: float, y_m: float) -> None:
        self._lane = lane
        place = lane.locate(x_m, y_m)
        self._station_m, self.lateral_m = float(place.s_m), float(place.lateral_m)
        self.distance_m = 0.0
        """Since the start; laps add up, ways back count less [m]."""

    def move(self, x_m: np.ndarray | float, y_m: np.ndarray | float) -> None:
        """The ego's next places, world [places] [m], in order; between two of them it has driven
        less than half a lap."""
        place = self._lane.locate(np.atleast_1d(x_m), np.atleast_1d(y_m))
        if not place.s_m.size:
            return
        ways = self._lane.shorter_way(np.diff(place.s_m, prepend=self._station_m))
        # One after the other, whoever gives them at once: a pairwise sum has other last bits.
        for way_m in ways.tolist():
            self.distance_m += way_m
        self._station_m, self.lateral_m = float(place.s_m[-1]), float(place.lateral_m[-1])

    @staticmethod
    def move_together(egos: Sequence[LaneProgress], x_m: np.ndarray, y_m: np.ndarray) -> None:
        """The next place of each of ``egos``, world [egos] [m], as :meth:`move` takes it: to find
        one on a lane takes as long as to find hundreds."""
        for lane in {id(ego._lane): ego._lane for ego in egos}.values():
            own = [number for number, ego in enumerate(egos) if ego._lane is lane]
            place = lane.locate(x_m[own], y_m[own])
            before_m = np.array([egos[number]._station_m for number in own])
            ways = lane.shorter_way(place.s_m - before_m)
            for number, way_m, station_m, lateral_m in zip(
                own, ways.tolist(), place.s_m.tolist(), place.lateral_m.tolist(), strict=True
            ):
                ego = egos[number]
                ego.distance_m += way_m
                ego._station_m, ego.lateral_m = station_m, lateral_m
