"""Warp functions: which lanes a road has at a station, and where they lie.

Lanes have the ids of the file: positive to the left, 0: none. Their borders are those of
``twin.road.opendrive.cross_section``. On the flat ground, road -1, there are no lanes.
"""

from __future__ import annotations

import warp as wp

from twin.road.walk.road_arrays import RoadArrays
from twin.road.walk.spots import HALF, SECTION, ZERO, cubic_at, offset_at

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_WIDTH, _BORDERED, _TYPE, _SIGN = (wp.constant(wp.int32(k)) for k in range(4))


@wp.func
def section_row(roads: RoadArrays, road: wp.int32, s: wp.float64) -> wp.int32:
    """The lane section at a station; a station between two belongs to the second."""
    low = roads.roads[road, SECTION]
    high = roads.roads[road + 1, SECTION]
    while high - low > 1:
        middle = (low + high) // 2
        if roads.section_starts[middle] <= s:
            low = middle
        else:
            high = middle
    return low


@wp.func
def lane_row(roads: RoadArrays, section: wp.int32, lane: wp.int32) -> wp.int32:
    """The row of a section's lane in ``roads.lanes``, -1 if there is no such lane."""
    left = roads.sections[section, 1]
    middle = roads.sections[section, 0] + left
    if lane > 0 and lane <= left:
        return middle - lane
    if lane < 0 and middle - lane <= roads.sections[section + 1, 0]:
        return middle - lane - 1
    return -1


@wp.func
def border_beyond(
    roads: RoadArrays,
    section: wp.int32,
    lane: wp.int32,
    base: wp.vec2d,
    inner: wp.vec2d,
    s: wp.float64,
) -> wp.vec2d:
    """t and slope of the outer border of a lane, from those of its inner border and of lane 0."""
    row = lane_row(roads, section, lane)
    ahead = s - roads.section_starts[section]
    value = cubic_at(roads.widths, roads.lanes[row, _WIDTH], roads.lanes[row + 1, _WIDTH], ahead)
    if roads.lanes[row, _BORDERED] == 1:
        return base + value
    if value[0] < ZERO:
        return inner
    if lane > 0:
        return inner + value
    return inner - value


@wp.func
def border_at(
    roads: RoadArrays, road: wp.int32, section: wp.int32, lane: wp.int32, s: wp.float64
) -> wp.vec2d:
    """t and slope of the outer border of a lane; of lanes that are not there that of the last."""
    base = offset_at(roads, road, s)
    border = base
    step = wp.where(lane > 0, 1, -1)
    # No range(abs(lane)): ptxas 13.4 reads that bound from a register that is not set yet.
    beside = wp.int32(step)
    end = lane + step
    while beside != end:
        if lane_row(roads, section, beside) >= 0:
            border = border_beyond(roads, section, beside, base, border, s)
        beside += step
    return border


@wp.func
def centre_in(
    roads: RoadArrays, road: wp.int32, section: wp.int32, lane: wp.int32, s: wp.float64
) -> wp.vec2d:
    """t and slope of the middle of a lane of a section; of lane 0, and of lanes that are not
    there, of the line that lanes are counted from."""
    if lane_row(roads, section, lane) < 0:
        return offset_at(roads, road, s)
    inside = wp.where(lane > 0, lane - 1, lane + 1)
    inner = border_at(roads, road, section, inside, s)
    outer = border_beyond(roads, section, lane, offset_at(roads, road, s), inner, s)
    return HALF * (inner + outer)


@wp.func
def lane_in(
    roads: RoadArrays, road: wp.int32, section: wp.int32, s: wp.float64, t: wp.float64
) -> wp.int32:
    """The lane of a section in which a place lies, 0 where there is none; the centre line belongs
    to lane -1, other borders to the lane inside of them."""
    base = offset_at(roads, road, s)
    inner = base
    lane = wp.int32(0)
    for number in range(1, roads.sections[section, 1] + 1):
        outer = border_beyond(roads, section, number, base, inner, s)
        if t > inner[0] and t <= outer[0]:
            lane = number
        inner = outer
    if lane > 0:
        return lane
    inner = base
    middle = roads.sections[section, 0] + roads.sections[section, 1]
    for number in range(1, roads.sections[section + 1, 0] - middle + 1):
        outer = border_beyond(roads, section, -number, base, inner, s)
        at_centre = number == 1 and t == base[0]
        if t >= outer[0] and (t < inner[0] or at_centre):
            lane = -number
        inner = outer
    return lane


@wp.func
def lane_exists(roads: RoadArrays, road: wp.int32, lane: wp.int32, s: wp.float64) -> wp.bool:
    """True if the road has such a lane at a station."""
    if road < 0:
        return False
    return lane_row(roads, section_row(roads, road, s), lane) >= 0


@wp.func
def lane_centre(roads: RoadArrays, road: wp.int32, lane: wp.int32, s: wp.float64) -> wp.vec2d:
    """t of the middle of a lane [m], and its slope dt/ds; lane 0, and lanes that are not there:
    the line that lanes are counted from."""
    if road < 0:
        return wp.vec2d(ZERO, ZERO)
    return centre_in(roads, road, section_row(roads, road, s), lane, s)


@wp.func
def lane_width(roads: RoadArrays, road: wp.int32, lane: wp.int32, s: wp.float64) -> wp.float64:
    """Width of a lane, 0 of one that is not there [m]."""
    if road < 0:
        return ZERO
    section = section_row(roads, road, s)
    if lane_row(roads, section, lane) < 0:
        return ZERO
    inside = wp.where(lane > 0, lane - 1, lane + 1)
    inner = border_at(roads, road, section, inside, s)
    outer = border_beyond(roads, section, lane, offset_at(roads, road, s), inner, s)
    return wp.abs(outer[0] - inner[0])


@wp.func
def lane_at(roads: RoadArrays, road: wp.int32, s: wp.float64, t: wp.float64) -> wp.int32:
    """The lane in which a place of a road lies, 0 where there is none."""
    if road < 0:
        return 0
    return lane_in(roads, road, section_row(roads, road, s), s, t)


@wp.func
def lane_sign(roads: RoadArrays, road: wp.int32, lane: wp.int32, s: wp.float64) -> wp.int32:
    """The way a lane is driven: 1 along s, -1 against it, 0 both; 0 if it is not there."""
    if road < 0:
        return 0
    row = lane_row(roads, section_row(roads, road, s), lane)
    if row < 0:
        return 0
    return roads.lanes[row, _SIGN]


@wp.func
def lane_type(roads: RoadArrays, road: wp.int32, lane: wp.int32, s: wp.float64) -> wp.int32:
    """Code of a lane's type (``LANE_TYPE_CODES``), -1 if it is not there."""
    if road < 0:
        return -1
    row = lane_row(roads, section_row(roads, road, s), lane)
    if row < 0:
        return -1
    return roads.lanes[row, _TYPE]


@wp.func
def lane_driven(roads: RoadArrays, road: wp.int32, lane: wp.int32, s: wp.float64) -> wp.bool:
    """True if cars drive on a lane."""
    code = lane_type(roads, road, lane, s)
    if code < 0:
        return False
    return roads.driven[code] == 1


@wp.func
def lane_count(roads: RoadArrays, road: wp.int32, s: wp.float64) -> wp.vec2i:
    """How many lanes there are on the left and on the right of a station."""
    if road < 0:
        return wp.vec2i(0, 0)
    section = section_row(roads, road, s)
    left = roads.sections[section, 1]
    both = roads.sections[section + 1, 0] - roads.sections[section, 0]
    return wp.vec2i(left, both - left)


@wp.func
def lane_beside(
    roads: RoadArrays, road: wp.int32, s: wp.float64, lane: wp.int32, steps: wp.int32
) -> wp.int32:
    """The lane ``steps`` ids further to the left (negative: to the right), not counting 0; 0 if
    there is none. A relative lane of OpenSCENARIO is as seen by an entity: who heads against s
    turns its sign."""
    target = lane + steps
    if lane > 0 and target <= 0:
        target -= 1
    elif lane < 0 and target >= 0:
        target += 1
    if not lane_exists(roads, road, target, s):
        return 0
    return target
