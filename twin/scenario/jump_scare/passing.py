"""Whether the ego went past the target: places along the lane, from the rows of a case."""

from __future__ import annotations

import numpy as np

from twin.base.portable.host import sine_cosine
from twin.scenario.protocol import Rows
from twin.scenario.surroundings import Surroundings

_CORNERS = np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)])
_PLACED_ROWS = 2
"""A co-simulated car may be put anywhere at its first pose: what is past by then went nowhere."""


def past_from(ground: Surroundings, rows: Rows) -> int | None:
    """The first row at which the whole hull lies beyond the target along the lane; None: never, or
    there is no target."""
    if ground.target is None:
        return None
    lane = ground.lane
    x, y, yaw = (rows.column(name) for name in ("x_m", "y_m", "yaw_rad"))
    sine, cosine = sine_cosine(yaw)
    centre_x = x + ground.centre_offset_m * cosine
    centre_y = y + ground.centre_offset_m * sine
    station = np.asarray(lane.locate(x, y).s_m)
    driven = station[0] + np.append(0.0, np.cumsum(lane.shorter_way(np.diff(station))))
    corners = _corners(centre_x, centre_y, yaw, ground.half_length_m, ground.half_width_m)
    rear = lane.shorter_way(lane.locate(*corners).s_m - station).min(axis=0)
    tx, ty, tyaw, half_length, half_width = ground.target.tolist()
    ends = _corners(np.array(tx), np.array(ty), np.array(tyaw), half_length, half_width)
    middle = float(lane.locate(tx, ty).s_m)
    front = middle + float(lane.shorter_way(lane.locate(*ends).s_m - middle).max())
    ahead = front - station[0]
    if lane.closed:
        ahead %= lane.length_m
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
    sine, cosine = sine_cosine(yaw_rad)
    return x_m + along * cosine - across * sine, y_m + along * sine + across * cosine
