"""Whether the ego went past the obstacle: places along the lane, from the rows of a case."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from twin.kpi.recorder import CaseRows
from twin.road.lane import LanePath

if TYPE_CHECKING:  # who judges what is written needs no world
    from twin.vehicle.vehicle_file import Vehicle
    from twin.world.street.build import World

_CORNERS = np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)])
_PLACED_ROWS = 2
"""A co-simulated car may be put anywhere at its first pose: what is past by then went nowhere."""


@dataclass(frozen=True, slots=True)
class Course:
    """The lane of a world, what stands in it, and how long the ego is."""

    lane: LanePath
    target: np.ndarray | None
    """Hull of the obstacle [5]: x, y [m], yaw [rad], half length and width [m]; None: nothing
    stands in the lane."""
    centre_offset_m: float
    """From the ego's reference point to the middle of its hull, forward."""
    half_length_m: float
    half_width_m: float

    @classmethod
    def of(cls, world: World, vehicle: Vehicle) -> Course:
        """For a vehicle in a world."""
        return cls(
            world.lane,
            world.target,
            vehicle.centre_offset_m,
            vehicle.length_m / 2,
            vehicle.width_m / 2,
        )

    def past_from(self, rows: CaseRows) -> int | None:
        """The first row at which the whole hull lies beyond the obstacle along the lane; None:
        never, or there is no obstacle."""
        if self.target is None:
            return None
        x, y, yaw = (rows.column(name) for name in ("x_m", "y_m", "yaw_rad"))
        cosine, sine = np.cos(yaw), np.sin(yaw)
        centre_x = x + self.centre_offset_m * cosine
        centre_y = y + self.centre_offset_m * sine
        station = np.asarray(self.lane.locate(x, y).s_m)
        driven = station[0] + np.append(0.0, np.cumsum(self.lane.shorter_way(np.diff(station))))
        corners = _corners(centre_x, centre_y, yaw, self.half_length_m, self.half_width_m)
        rear = self.lane.shorter_way(self.lane.locate(*corners).s_m - station).min(axis=0)
        tx, ty, tyaw, half_length, half_width = self.target.tolist()
        ends = _corners(np.array(tx), np.array(ty), np.array(tyaw), half_length, half_width)
        middle = float(self.lane.locate(tx, ty).s_m)
        front = middle + float(self.lane.shorter_way(self.lane.locate(*ends).s_m - middle).max())
        ahead = front - station[0]
        if self.lane.closed:
            ahead %= self.lane.length_m
        past = np.flatnonzero(driven + rear - station[0] > ahead)
        if not len(past) or past[0] < _PLACED_ROWS:
            return None
        return int(past[0])


def _corners(
    x_m: np.ndarray, y_m: np.ndarray, yaw_rad: np.ndarray, half_length_m: float, half_width_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """World x and y [4, ...] of the corners of boxes."""
    along, across = (_CORNERS * (half_length_m, half_width_m)).T
    shape = (4,) + (1,) * x_m.ndim
    along, across = along.reshape(shape), across.reshape(shape)
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    return x_m + along * cosine - across * sine, y_m + along * sine + across * cosine
