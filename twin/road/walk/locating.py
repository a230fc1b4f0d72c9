"""Warp functions: which road and lane are under a point."""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_cos, portable_sin
from twin.road.walk.lanes import lane_at
from twin.road.walk.poses import level_edge, tilted_across
from twin.road.walk.road_arrays import RoadArrays
from twin.road.walk.spots import (
    HALF,
    LINE,
    ONE,
    ZERO,
    elevation_at,
    line_row,
    line_spot,
    road_length,
    tilt_at,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NEAR_M = 20.0
"""How far along a road from where it was a point is looked for first [m]."""
STOREY_M = 1.0
"""Surfaces count as equally near in height within about this [m]."""
FOOT_STEPS = 40
"""Most steps to the foot of a point."""

_NEAR_M = wp.constant(wp.float64(NEAR_M))
_STOREY_M = wp.constant(wp.float64(STOREY_M))
_FOOT_STEPS = wp.constant(wp.int32(FOOT_STEPS))
_SLOPE_MIN = wp.constant(wp.float64(0.05))
_SETTLED_M = wp.constant(wp.float64(1e-11))
_PAST_M = wp.constant(wp.float64(1e-3))
"""How far beyond an end of a road a point still belongs to it [m]."""
_TIE_M2 = wp.constant(wp.float64(1e-9))
_FAR = wp.constant(wp.float64(1e300))


@wp.struct
class RoadSpot:
    """Where a point lies; road -1: there is no road at all, s is x and t is y."""

    road: wp.int32
    lane: wp.int32
    """0: on none."""
    s: wp.float64
    t: wp.float64
    h: wp.float64
    """Above the surface [m]."""
    past: wp.float64
    """How far beyond an end of the road, along its heading there [m]."""
    apart: wp.float64
    """Distance from the reference line in the plane [m]."""


@wp.func
def part_end(roads: RoadArrays, road: wp.int32, row: wp.int32) -> wp.float64:
    """Station at which a part of a reference line ends."""
    if row + 1 < roads.roads[road + 1, LINE]:
        return roads.lines[row + 1, 0]
    return road_length(roads, road)


@wp.func
def nearest_part(
    roads: RoadArrays, road: wp.int32, first: wp.int32, end: wp.int32, x: wp.float64, y: wp.float64
) -> wp.int32:
    """The part of a reference line, of ``first`` to ``end`` - 1, whose chord is nearest; of equally
    near ones the first."""
    best = first
    best_square = _FAR
    for row in range(first, end):
        stop = line_spot(roads, row, part_end(roads, road, row))
        from_x, from_y = roads.lines[row, 1], roads.lines[row, 5]
        chord_x, chord_y = stop.x - from_x, stop.y - from_y
        dx, dy = x - from_x, y - from_y
        square = wp.max(chord_x * chord_x + chord_y * chord_y, wp.float64(1e-24))
        share = wp.clamp((dx * chord_x + dy * chord_y) / square, ZERO, ONE)
        off_x, off_y = dx - share * chord_x, dy - share * chord_y
        off = off_x * off_x + off_y * off_y
        if off < best_square - _TIE_M2:
            best = row
            best_square = off
    return best


@wp.func
def foot_near(
    roads: RoadArrays, road: wp.int32, row: wp.int32, x: wp.float64, y: wp.float64
) -> wp.float64:
    """Station of the foot of a point on the part ``row`` of a reference line or one beside it:
    Newton's steps on the distance along the tangent, halving where they would leave."""
    first, end = roads.roads[road, LINE], roads.roads[road + 1, LINE]
    low_row, high_row = wp.max(row - 1, first), wp.min(row + 1, end - 1)
    low = wp.float64(roads.lines[low_row, 0])
    high = wp.float64(part_end(roads, road, high_row))
    spot = line_spot(roads, low_row, low)
    if spot.cosine * (x - spot.x) + spot.sine * (y - spot.y) <= ZERO:
        return low
    spot = line_spot(roads, high_row, high)
    if spot.cosine * (x - spot.x) + spot.sine * (y - spot.y) >= ZERO:
        return high
    s = HALF * (roads.lines[row, 0] + part_end(roads, road, row))
    step = ONE
    steps = wp.int32(0)
    while wp.abs(step) > _SETTLED_M and steps < _FOOT_STEPS:
        steps += 1
        at = low_row
        while at < high_row and part_end(roads, road, at) <= s:
            at += 1
        spot = line_spot(roads, at, s)
        dx, dy = x - spot.x, y - spot.y
        ahead = spot.cosine * dx + spot.sine * dy
        beside = spot.cosine * dy - spot.sine * dx
        if ahead > ZERO:
            low = s
        else:
            high = s
        slope = ONE - spot.curvature * beside
        further = s + ahead / wp.where(slope > _SLOPE_MIN, slope, ONE)
        if further < low or further > high:
            further = HALF * (low + high)
        step = further - s
        s = further
    return s


@wp.func
def spot_on(
    roads: RoadArrays,
    road: wp.int32,
    first: wp.int32,
    end: wp.int32,
    x: wp.float64,
    y: wp.float64,
    z: wp.float64,
) -> RoadSpot:
    """Where a point lies as seen from the parts ``first`` to ``end`` - 1 of a road's reference
    line; z no number: on the surface."""
    place = RoadSpot()
    place.road = road
    place.s = foot_near(roads, road, nearest_part(roads, road, first, end, x, y), x, y)
    spot = line_spot(roads, line_row(roads, road, place.s), place.s)
    dx, dy = x - spot.x, y - spot.y
    side = spot.cosine * dy - spot.sine * dx
    place.past = wp.abs(spot.cosine * dx + spot.sine * dy)
    place.apart = wp.sqrt(dx * dx + dy * dy)
    tilt = tilt_at(roads, road, place.s)
    cosine, sine = portable_cos(tilt[0]), portable_sin(tilt[0])
    place.t = side / cosine
    height = elevation_at(roads, road, place.s)
    up = z - height[0]
    edge = level_edge(roads, road, place.s, side / cosine)
    if edge[2] == ONE:
        across = tilted_across(edge[0], cosine, sine, tilt[1])
        place.t = edge[0] + side - across.side
        place.h = up - across.up
    elif not wp.isnan(z):
        place.t = side * cosine + up * sine
        place.h = up * cosine - side * sine
    if wp.isnan(z):
        place.h = ZERO
    if place.past <= _PAST_M:
        place.lane = lane_at(roads, road, place.s, place.t)
    return place


@wp.func
def better(one: RoadSpot, other: RoadSpot) -> wp.bool:
    """True if ``one`` is the place to say rather than ``other``: on a lane rather than beside all,
    then on the nearer storey, then nearer to the reference line."""
    if other.road < 0:
        return True
    if (one.lane != 0) != (other.lane != 0):
        return one.lane != 0
    if one.lane == 0:
        return one.apart < other.apart
    storey = wp.floor(wp.abs(one.h) / _STOREY_M + HALF)
    other_storey = wp.floor(wp.abs(other.h) / _STOREY_M + HALF)
    if storey != other_storey:
        return storey < other_storey
    return wp.abs(one.t) < wp.abs(other.t)


@wp.func
def spot_around(
    roads: RoadArrays,
    road: wp.int32,
    s: wp.float64,
    x: wp.float64,
    y: wp.float64,
    z: wp.float64,
) -> RoadSpot:
    """Where a point lies as seen from the parts of a road within ``NEAR_M`` of a station."""
    first = line_row(roads, road, s - _NEAR_M)
    last = line_row(roads, road, s + _NEAR_M)
    return spot_on(roads, road, first, last + 1, x, y, z)


@wp.func
def spot_beyond(
    roads: RoadArrays, end: wp.int32, x: wp.float64, y: wp.float64, z: wp.float64
) -> RoadSpot:
    """The best place of a point on the roads that touch an end of a road; its road is -1 if none
    does."""
    best = RoadSpot()
    best.road = -1
    for way in range(roads.way_first[end], roads.way_first[end + 1]):
        road = roads.ways[way, 0]
        begin = wp.where(roads.ways[way, 1] == 1, road_length(roads, road), ZERO)
        spot = spot_around(roads, road, begin, x, y, z)
        if better(spot, best):
            best = spot
    return best


@wp.func
def spot_anywhere(roads: RoadArrays, x: wp.float64, y: wp.float64, z: wp.float64) -> RoadSpot:
    """The best place of a point on all roads; roads too far away to be under it come last."""
    best = RoadSpot()
    best.road = -1
    for road in range(roads.count):
        reach = roads.extents[road, 5]
        dx = wp.max(wp.max(roads.extents[road, 1] - x, x - roads.extents[road, 3]), ZERO)
        dy = wp.max(wp.max(roads.extents[road, 2] - y, y - roads.extents[road, 4]), ZERO)
        away = wp.sqrt(dx * dx + dy * dy)
        if away <= reach or best.road < 0 or (best.lane == 0 and away <= best.apart):
            first, end = roads.roads[road, LINE], roads.roads[road + 1, LINE]
            spot = spot_on(roads, road, first, end, x, y, z)
            if better(spot, best):
                best = spot
    return best


@wp.func
def road_locate(
    roads: RoadArrays,
    x: wp.float64,
    y: wp.float64,
    z: wp.float64,
    near_road: wp.int32,
    near_s: wp.float64,
) -> RoadSpot:
    """Where a world point lies on the roads.

    A point that is on a lane of the road it was on, within ``NEAR_M`` along it, stays there; then
    the roads that touch the nearer end count, then all. Of several roads above one another the one
    in whose storey it is counts, then the one whose reference line is nearest, then the first. A
    point on no lane stays on its road unless that has ended, and then belongs to the nearest.

    Args:
        roads: the network.
        x, y, z: the point; z no number: on the surface.
        near_road: where it was before; -1: unknown.
        near_s: the same.
    """
    best = RoadSpot()
    best.road = -1
    best.s = x
    best.t = y
    if not wp.isnan(z):
        best.h = z
    if roads.count == 0:
        return best
    if near_road >= 0:
        best = spot_around(roads, near_road, near_s, x, y, z)
        if best.lane != 0:
            return best
        at_end = wp.where(best.s > HALF * road_length(roads, near_road), 1, 0)
        beyond = spot_beyond(roads, 2 * near_road + at_end, x, y, z)
        if beyond.road >= 0 and beyond.lane != 0:
            return beyond
    everywhere = spot_anywhere(roads, x, y, z)
    if near_road >= 0 and everywhere.lane == 0 and best.past <= _PAST_M:
        return best
    return everywhere
