"""Warp functions: how far apart two places are along the roads."""

from __future__ import annotations

import warp as wp

from twin.road.walk.road_arrays import RoadArrays
from twin.road.walk.spots import ZERO, road_length

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_FAR = wp.constant(wp.float64(1e300))


@wp.struct
class RoadApart:
    """One place as seen from another."""

    reached: wp.int32
    """0: no way leads there, or the network is too large for the table."""
    ds: wp.float64
    """Along the reference lines, in direction of the first one's s positive [m]."""
    dt: wp.float64
    """To the left as seen along the first one's s [m]."""
    sign: wp.int32
    """-1: s of the second one runs the other way there."""


@wp.func
def way_between(
    roads: RoadArrays,
    road: wp.int32,
    leave: wp.int32,
    s: wp.float64,
    other_road: wp.int32,
    enter: wp.int32,
    other_s: wp.float64,
) -> wp.float64:
    """Length of the way out of an end of a road and into an end of the other; infinite: none."""
    between = roads.lengths[2 * road + leave, 2 * other_road + enter]
    out = wp.where(leave == 1, road_length(roads, road) - s, s)
    into = wp.where(enter == 1, road_length(roads, other_road) - other_s, other_s)
    return out + between + into


@wp.func
def road_apart(
    roads: RoadArrays,
    road: wp.int32,
    s: wp.float64,
    t: wp.float64,
    other_road: wp.int32,
    other_s: wp.float64,
    other_t: wp.float64,
) -> RoadApart:
    """The other place as seen from the first, by the shortest way, whichever way lanes are driven.

    On one road the way along it counts. Of equally long ways the one ahead counts. On the flat
    ground, both roads -1, x and y differ by ds and dt.
    """
    apart = RoadApart()
    apart.sign = 1
    if road == other_road:
        apart.reached = 1
        apart.ds = other_s - s
        apart.dt = other_t - t
        return apart
    if road < 0 or other_road < 0 or roads.measured == 0:
        return apart
    best = _FAR
    for number in range(4):
        leave = 1 - number // 2
        enter = number % 2
        way = way_between(roads, road, leave, s, other_road, enter, other_s)
        if way < best:
            best = way
            apart.reached = 1
            apart.sign = wp.where(leave == enter, -1, 1)
            apart.ds = wp.where(leave == 1, way, -way)
    if apart.reached == 1:
        apart.dt = other_t * wp.float64(apart.sign) - t
    else:
        apart.ds = ZERO
    return apart
