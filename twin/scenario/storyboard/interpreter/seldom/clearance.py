"""Warp functions: whether lanes beside an entity are free (RelativeClearanceCondition).

ASAM OpenSCENARIO XML 1.3, class reference: the area reaches from the entity's origin so far ahead
and behind, along the middle of its lane, over lanes counted to its left; others count by their
origins or by their whole boxes. Of lanes that are not there none is free, as in esmini; the
standard leaves it open.

The middle of a lane at t of a reference line that turns by an angle is ds - t * angle long. On the
entity's road and on the other's that is exact for a constant t; on roads between them the reference
line counts.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_atan2
from twin.road.walk.distances import RoadApart, road_apart
from twin.road.walk.lanes import lane_at, lane_centre, lane_count, lane_driven, lane_sign
from twin.road.walk.moves import move_on_lane, walk
from twin.road.walk.road_arrays import RoadArrays
from twin.road.walk.spots import line_row, line_spot, road_length
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.boxes import box_of, reach_of
from twin.scenario.storyboard.interpreter.ground import direction_of, front_of, lane_counted
from twin.scenario.storyboard.interpreter.transition import CLOSE, ZERO
from twin.scenario.storyboard.player.columns import Real, Whole
from twin.scenario.storyboard.player.layout import layout_of, real_column, whole_column
from twin.scenario.storyboard.program.conditions import RelativeClearanceCondition

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

_AHEAD = real_column(RelativeClearanceCondition, "ahead_m")
_BEHIND = real_column(RelativeClearanceCondition, "behind_m")
_FREE = whole_column(RelativeClearanceCondition, "freespace")
_OPPOSITE = whole_column(RelativeClearanceCondition, "opposite")
_ENTITIES = whole_column(RelativeClearanceCondition, "entities.tail")
_RANGES = whole_column(RelativeClearanceCondition, "ranges.tail")
_TAIL = len(layout_of(RelativeClearanceCondition).wholes)
_NOWHERE = wp.constant(wp.int32(1 << 30))
"""Count of a lane to which no lane leads."""
_NEAR_M = wp.constant(wp.float64(1e-3))


@wp.func
def steps_to(lane: wp.int32, other: wp.int32) -> wp.int32:
    """How many lanes to the left along s the other one is; 0 does not count as one."""
    if lane < 0 and other > 0:
        return other - lane - 1
    if lane > 0 and other < 0:
        return other - lane + 1
    return other - lane


@wp.func
def in_ranges(tables: ProgramArrays, wholes: wp.int32, steps: wp.int32) -> wp.bool:
    """True if a condition asks for the lane so many to the left of the entity's own."""
    count = tables.wholes[wholes + _RANGES]
    first = wholes + _TAIL + tables.wholes[wholes + _ENTITIES]
    for k in range(count):
        low, high = tables.wholes[first + 2 * k], tables.wholes[first + 2 * k + 1]
        if steps >= low and steps <= high:
            return True
    return count == 0


@wp.func
def is_meant(tables: ProgramArrays, wholes: wp.int32, entity: wp.int32) -> wp.bool:
    """True if lanes must be free of an entity."""
    count = tables.wholes[wholes + _ENTITIES]
    for k in range(count):
        if tables.wholes[wholes + _TAIL + k] == entity:
            return True
    return count == 0


@wp.func
def lane_there(
    tables: ProgramArrays,
    bodies: BodyArrays,
    roads: RoadArrays,
    slot: wp.int32,
    e: wp.int32,
    wholes: wp.int32,
) -> wp.bool:
    """True if any lane that a condition asks for is there, and driven on, where the entity is."""
    road = bodies.wholes[slot, e, Whole.ROAD]
    lane = bodies.wholes[slot, e, Whole.LANE]
    if road < 0 or lane == 0:
        return False
    s = bodies.reals[slot, e, Real.S]
    sign = direction_of(bodies.reals[slot, e, Real.TURN])
    own = lane_sign(roads, road, lane, s)
    count = lane_count(roads, road, s)
    for other in range(-count[1], count[0] + 1):
        asked = other != 0 and lane_driven(roads, road, other, s)
        if asked and own * lane_sign(roads, road, other, s) < 0:
            asked = tables.wholes[wholes + _OPPOSITE] != 0
        if asked and in_ranges(tables, wholes, steps_to(lane, other) * sign):
            return True
    return False


@wp.func
def turn_along(roads: RoadArrays, road: wp.int32, begin: wp.float64, end: wp.float64):
    """Angle by which a reference line turns between two stations, less than half a turn."""
    one = line_spot(roads, line_row(roads, road, begin), begin)
    other = line_spot(roads, line_row(roads, road, end), end)
    cross = one.cosine * other.sine - one.sine * other.cosine
    return portable_atan2(cross, one.cosine * other.cosine + one.sine * other.sine)


@wp.func
def steps_between(
    roads: RoadArrays,
    road: wp.int32,
    s: wp.float64,
    lane: wp.int32,
    other_road: wp.int32,
    other_s: wp.float64,
    other_lane: wp.int32,
    apart: RoadApart,
) -> wp.int32:
    """How many lanes to the left along s the other lane is, counted where it leads to the entity's
    road, else where the entity's lane leads to the other's; ``_NOWHERE``: neither."""
    steps = wp.int32(_NOWHERE)
    if road == other_road:
        steps = steps_to(lane, other_lane)
    for turn in range(2):
        # On one road ids tell where no walk comes through; those of other sections may differ.
        back = turn == 0
        if back or steps == _NOWHERE:
            from_road = wp.where(back, other_road, road)
            from_lane = wp.where(back, other_lane, lane)
            from_s = wp.where(back, other_s, s)
            way = wp.where(back, -apart.ds * wp.float64(apart.sign), apart.ds)
            move = move_on_lane(roads, from_road, from_lane, from_s, ZERO, 1)
            move = walk(roads, roads.driven, wp.vec2i(0, 0), move, way)
            to_road = wp.where(back, road, other_road)
            to_s = wp.where(back, s, other_s)
            if move.road == to_road and move.lane != 0 and wp.abs(move.s - to_s) < _NEAR_M:
                if back:
                    steps = steps_to(lane, move.lane)
                else:
                    steps = steps_to(move.lane, other_lane) * apart.sign
    return steps


@wp.func
def way_along_lane(
    roads: RoadArrays,
    road: wp.int32,
    s: wp.float64,
    lane: wp.int32,
    other_road: wp.int32,
    other_s: wp.float64,
    other_lane: wp.int32,
    apart: RoadApart,
) -> wp.float64:
    """Way along the middle of a lane, as seen along s; ``other_lane`` continues it there."""
    middle = lane_centre(roads, road, lane, s)[0]
    if road == other_road:
        return apart.ds - middle * turn_along(roads, road, s, other_s)
    ahead = apart.ds > ZERO
    end = wp.where(ahead, road_length(roads, road), ZERO)
    begin = wp.where(ahead == (apart.sign > 0), ZERO, road_length(roads, other_road))
    there = lane_centre(roads, other_road, other_lane, other_s)[0]
    own = middle * turn_along(roads, road, s, end)
    return (
        apart.ds
        - own
        - wp.float64(apart.sign) * there * turn_along(roads, other_road, begin, other_s)
    )


@wp.func
def touched_lane(roads: RoadArrays, road: wp.int32, s: wp.float64, t: wp.float64) -> wp.int32:
    """The lane at t; beyond the outermost ones the next id."""
    lane = lane_at(roads, road, s, t)
    if lane != 0:
        return lane
    count = lane_count(roads, road, s)
    if t > lane_centre(roads, road, 0, s)[0]:
        return count[0] + 1
    return -count[1] - 1


@wp.func
def occupies(
    tables: ProgramArrays,
    bodies: BodyArrays,
    roads: RoadArrays,
    slot: wp.int32,
    base: wp.int32,
    e: wp.int32,
    other: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
) -> wp.bool:
    """True if another entity is in the area of a condition."""
    road, lane = bodies.wholes[slot, e, Whole.ROAD], bodies.wholes[slot, e, Whole.LANE]
    s = bodies.reals[slot, e, Real.S]
    other_road = bodies.wholes[slot, other, Whole.ROAD]
    other_s, other_t = bodies.reals[slot, other, Real.S], bodies.reals[slot, other, Real.T]
    if other_road < 0:
        return False
    apart = road_apart(roads, road, s, bodies.reals[slot, e, Real.T], other_road, other_s, other_t)
    if apart.reached == 0:
        return False
    sign = direction_of(bodies.reals[slot, e, Real.TURN])
    low_lane = bodies.wholes[slot, other, Whole.LANE]
    high_lane = low_lane
    centre = wp.float64(0.0)
    reach = wp.float64(0.0)
    if tables.wholes[wholes + _FREE] != 0:
        box = box_of(tables, bodies, slot, base + other, other)
        spot = line_spot(roads, line_row(roads, other_road, other_s), other_s)
        x = box.x - bodies.reals[slot, other, Real.X]
        y = box.y - bodies.reals[slot, other, Real.Y]
        aside = y * spot.cosine - x * spot.sine
        wide = reach_of(box, -spot.sine, spot.cosine)
        low_lane = touched_lane(roads, other_road, other_s, other_t + aside - wide)
        high_lane = touched_lane(roads, other_road, other_s, other_t + aside + wide)
        centre = (x * spot.cosine + y * spot.sine) * wp.float64(apart.sign)
        reach = reach_of(box, spot.cosine, spot.sine)
    count = lane_count(roads, other_road, other_s)
    low_lane, high_lane = wp.max(low_lane, -count[1]), wp.min(high_lane, count[0])
    if low_lane == 0:
        low_lane = 1
    if low_lane > high_lane:
        return False
    steps = steps_between(roads, road, s, lane, other_road, other_s, low_lane, apart)
    if steps == _NOWHERE:
        return False
    same = lane_counted(low_lane, -steps * apart.sign)
    way = way_along_lane(roads, road, s, lane, other_road, other_s, same, apart)
    way = (way + centre) * wp.float64(sign)
    if way - reach > tables.reals[reals + _AHEAD] + CLOSE:
        return False
    if way + reach < -tables.reals[reals + _BEHIND] - CLOSE:
        return False
    own = lane_sign(roads, road, lane, s) * apart.sign
    for touched in range(low_lane, high_lane + 1):
        asked = touched != 0
        if asked and own * lane_sign(roads, other_road, touched, other_s) < 0:
            asked = tables.wholes[wholes + _OPPOSITE] != 0
        seen_left = (steps + steps_to(low_lane, touched) * apart.sign) * sign
        if asked and in_ranges(tables, wholes, seen_left):
            return True
    return False


@wp.func
def clear_beside(
    tables: ProgramArrays,
    bodies: BodyArrays,
    roads: RoadArrays,
    slot: wp.int32,
    base: wp.int32,
    count: wp.int32,
    e: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
) -> wp.bool:
    """True if the lanes that a condition asks for are free of all whom it means, but for the
    entity's own train; never of an entity that is on no lane."""
    if not lane_there(tables, bodies, roads, slot, e, wholes):
        return False
    for other in range(count):
        meant = other != e and bodies.wholes[slot, other, Whole.PRESENT] != 0
        meant = meant and front_of(bodies, slot, e) != front_of(bodies, slot, other)
        if meant and is_meant(tables, wholes, other):
            if occupies(tables, bodies, roads, slot, base, e, other, reals, wholes):
                return False
    return True
