"""Warp functions: where bodies stand, on roads and beside them.

A body on a road is held by its lane, its offset from the lane's middle and its ``turn``, the
heading relative to the direction of the lane along s. Its heading in the world follows from those.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_atan2, portable_cos, portable_sin
from twin.road.walk.lanes import lane_at, lane_centre
from twin.road.walk.locating import road_locate
from twin.road.walk.moves import move_on_lane, walk
from twin.road.walk.poses import road_pose
from twin.road.walk.road_arrays import RoadArrays
from twin.road.walk.spots import road_curvature
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.transition import ONE, PI, TWO, ZERO
from twin.scenario.storyboard.player.columns import Domain, Real, Whole
from twin.scenario.storyboard.player.layout import FIXED_FRAME, PLACE_REALS, PLACE_WHOLES
from twin.scenario.storyboard.program.places import RelativeFrame

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

PLACE_X = PLACE_REALS.index("x_m")
PLACE_HEADING = PLACE_REALS.index("heading_rad")
PLACE_S = PLACE_REALS.index("s_m")
PLACE_FRAME = PLACE_WHOLES.index("frame")
PLACE_ENTITY = PLACE_WHOLES.index("entity")
PLACE_ROAD = PLACE_WHOLES.index("road")
PLACE_LANES = PLACE_WHOLES.index("lanes")
_FIXED = wp.constant(wp.int32(FIXED_FRAME))
_X = wp.constant(wp.int32(PLACE_X))
_HEADING = wp.constant(wp.int32(PLACE_HEADING))
_S = wp.constant(wp.int32(PLACE_S))
_FRAME = wp.constant(wp.int32(PLACE_FRAME))
_ENTITY = wp.constant(wp.int32(PLACE_ENTITY))
_ROAD = wp.constant(wp.int32(PLACE_ROAD))
_LANES = wp.constant(wp.int32(PLACE_LANES))
_BOTH = wp.constant(wp.int32(Domain.LONGITUDINAL | Domain.LATERAL))
_QUARTER = wp.constant(wp.float64(1.5707963267948966))
_SLACK = wp.constant(wp.float64(1e-9))
_SHARE_MIN = wp.constant(wp.float64(0.05))


@wp.struct
class BodyPlace:
    """A pose in the world and the place on the road that belongs to it."""

    x: wp.float64
    y: wp.float64
    z: wp.float64
    heading: wp.float64
    pitch: wp.float64
    roll: wp.float64
    road: wp.int32
    lane: wp.int32
    s: wp.float64
    t: wp.float64
    offset: wp.float64
    turn: wp.float64
    road_heading: wp.float64
    leg: wp.int32
    at_end: wp.int32


@wp.func
def wrapped(angle: wp.float64) -> wp.float64:
    """The same angle in (-pi, pi]."""
    turns = wp.floor((angle + PI) / (TWO * PI))
    rest = angle - turns * TWO * PI
    return wp.where(rest == -PI, PI, rest)


@wp.func
def direction_of(turn: wp.float64) -> wp.int32:
    """1 of a body that heads along s, -1 of one that heads against it."""
    return wp.where(wp.abs(wrapped(turn)) <= _QUARTER + _SLACK, 1, -1)


@wp.func
def controlled_by(bodies: BodyArrays, slot: wp.int32, e: wp.int32) -> wp.int32:
    """Bits of ``Domain`` in which something else than actions moves a body: whoever imposes its
    poses, its tractor, or its driver model. A controller that is none of them leaves it to the
    default one."""
    if bodies.wholes[slot, e, Whole.IMPOSED] != 0 or bodies.wholes[slot, e, Whole.TRACTOR] >= 0:
        return _BOTH
    if bodies.wholes[slot, e, Whole.MODEL] < 0:
        return 0
    return bodies.wholes[slot, e, Whole.CONTROLLED]


@wp.func
def front_of(bodies: BodyArrays, slot: wp.int32, e: wp.int32) -> wp.int32:
    """Who is at the front of the train of an entity; itself if nobody tows it."""
    at = wp.int32(e)
    tractor = bodies.wholes[slot, at, Whole.TRACTOR]
    for _ahead in range(bodies.wholes.shape[1]):
        if tractor >= 0:
            at = tractor
            tractor = bodies.wholes[slot, at, Whole.TRACTOR]
    return at


@wp.func
def place_of(bodies: BodyArrays, slot: wp.int32, e: wp.int32) -> BodyPlace:
    """Where an entity stands."""
    place = BodyPlace()
    place.x = bodies.reals[slot, e, Real.X]
    place.y = bodies.reals[slot, e, Real.Y]
    place.z = bodies.reals[slot, e, Real.Z]
    place.heading = bodies.reals[slot, e, Real.HEADING]
    place.pitch = bodies.reals[slot, e, Real.PITCH]
    place.roll = bodies.reals[slot, e, Real.ROLL]
    place.s = bodies.reals[slot, e, Real.S]
    place.t = bodies.reals[slot, e, Real.T]
    place.offset = bodies.reals[slot, e, Real.OFFSET]
    place.turn = bodies.reals[slot, e, Real.TURN]
    place.road_heading = bodies.reals[slot, e, Real.ROAD_HEADING]
    place.road = bodies.wholes[slot, e, Whole.ROAD]
    place.lane = bodies.wholes[slot, e, Whole.LANE]
    place.leg = bodies.wholes[slot, e, Whole.LEG]
    return place


@wp.func
def keep_place(bodies: BodyArrays, slot: wp.int32, e: wp.int32, place: BodyPlace):
    """Store where an entity stands."""
    bodies.reals[slot, e, Real.X] = place.x
    bodies.reals[slot, e, Real.Y] = place.y
    bodies.reals[slot, e, Real.Z] = place.z
    bodies.reals[slot, e, Real.HEADING] = place.heading
    bodies.reals[slot, e, Real.PITCH] = place.pitch
    bodies.reals[slot, e, Real.ROLL] = place.roll
    bodies.reals[slot, e, Real.S] = place.s
    bodies.reals[slot, e, Real.T] = place.t
    bodies.reals[slot, e, Real.OFFSET] = place.offset
    bodies.reals[slot, e, Real.TURN] = place.turn
    bodies.reals[slot, e, Real.ROAD_HEADING] = place.road_heading
    bodies.wholes[slot, e, Whole.ROAD] = place.road
    bodies.wholes[slot, e, Whole.LANE] = place.lane
    bodies.wholes[slot, e, Whole.LEG] = place.leg


@wp.func
def moved_place(
    roads: RoadArrays,
    route: wp.array(dtype=wp.int32),
    span: wp.vec2i,
    place: BodyPlace,
    ahead: wp.float64,
    further_s: wp.float64,
) -> BodyPlace:
    """``place`` moved forwards by ``ahead``, measured at its t, and ``further_s``, measured along
    reference lines; on the open ground along its heading. Only road, lane, s, offset, turn, leg and
    ``at_end`` of the result count on a road."""
    if place.road < 0:
        place.x += (ahead + further_s) * portable_cos(place.heading)
        place.y += (ahead + further_s) * portable_sin(place.heading)
        place.s = place.x
        place.t = place.y
        return place
    sign = direction_of(place.turn)
    move = move_on_lane(roads, place.road, place.lane, place.s, place.offset, sign)
    move.route_at = span[0] + place.leg
    share = wp.max(ONE - road_curvature(roads, place.road, place.s) * move.t, _SHARE_MIN)
    distance = ahead / share + further_s
    if distance != ZERO:
        move = walk(roads, route, span, move, distance)
    place.road = move.road
    place.lane = move.lane
    place.s = move.s
    place.offset = move.offset
    place.leg = move.route_at - span[0]
    place.at_end = move.at_end
    if move.sign != sign:
        place.turn = wrapped(place.turn + PI)
    return place


@wp.func
def found_place(roads: RoadArrays, place: BodyPlace) -> BodyPlace:
    """``place`` with road, lane, s and t of its point; it was near its road and s before."""
    spot = road_locate(roads, place.x, place.y, place.z, place.road, place.s)
    place.road = spot.road
    place.lane = spot.lane
    place.s = spot.s
    place.t = spot.t
    return place


@wp.func
def posed_place(roads: RoadArrays, place: BodyPlace, on_road: wp.bool) -> BodyPlace:
    """What of a place follows from the rest.

    ``on_road``: the pose from lane, s, offset and turn; else turn and offset from the pose, whose
    road, lane, s and t are known. A body keeps to the surface, so with u the road's upward axis and
    f its own forward one, f = R(road) (cos turn, sin turn, 0), pitch and roll are those of the
    orientation with these axes (heading, pitch, roll about z, y, x as in ISO 8855).
    """
    if place.road < 0:
        place.offset = ZERO
        place.turn = ZERO
        place.road_heading = place.heading
        return place
    middle = lane_centre(roads, place.road, place.lane, place.s)
    t = middle[0] + place.offset
    if not on_road:
        t = place.t
    point = road_pose(roads, place.road, place.s, t)
    place.road_heading = point.heading
    slope = ZERO
    if middle[1] != ZERO:
        slope = portable_atan2(middle[1], ONE)
    place.t = t
    if not on_road:
        place.offset = t - middle[0]
        place.turn = wrapped(place.heading - point.heading - slope)
        return place
    place.x = point.x
    place.y = point.y
    place.z = point.z
    around = slope + place.turn
    place.heading = wrapped(point.heading + around)
    place.pitch = ZERO
    place.roll = ZERO
    if point.pitch != ZERO or point.roll != ZERO:
        up_sine, up_cosine = portable_sin(point.pitch), portable_cos(point.pitch)
        side_sine, side_cosine = portable_sin(point.roll), portable_cos(point.roll)
        ahead, left = portable_cos(around), portable_sin(around)
        # Components in the road's heading of the body's forward and left axes.
        forward_x = up_cosine * ahead + up_sine * side_sine * left
        forward_y = side_cosine * left
        forward_z = up_cosine * side_sine * left - up_sine * ahead
        left_z = up_cosine * side_sine * ahead + up_sine * left
        level = wp.sqrt(forward_x * forward_x + forward_y * forward_y)
        place.heading = wrapped(point.heading + portable_atan2(forward_y, forward_x))
        place.pitch = portable_atan2(-forward_z, level)
        place.roll = portable_atan2(left_z, up_cosine * side_cosine)
    return place


@wp.func
def snapped_lane(roads: RoadArrays, place: BodyPlace) -> BodyPlace:
    """``place`` held by the lane in which it lies, if there is one."""
    if place.road < 0:
        return place
    here = lane_centre(roads, place.road, place.lane, place.s)
    t = here[0] + place.offset
    lane = lane_at(roads, place.road, place.s, t)
    if lane != 0 and lane != place.lane:
        there = lane_centre(roads, place.road, lane, place.s)
        place.lane = lane
        place.offset = t - there[0]
        place.turn = wrapped(
            place.turn + portable_atan2(here[1], ONE) - portable_atan2(there[1], ONE)
        )
    return place


@wp.func
def lane_counted(lane: wp.int32, to_left: wp.int32) -> wp.int32:
    """The lane so many to the left along s; 0 does not count as one."""
    target = lane + to_left
    if lane < 0 and target >= 0:
        return target + 1
    if lane > 0 and target <= 0:
        return target - 1
    return target


@wp.func
def resolved_place(
    tables: ProgramArrays,
    bodies: BodyArrays,
    roads: RoadArrays,
    slot: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
) -> BodyPlace:
    """A position of a program as it is now; ``reals`` and ``wholes`` say where its columns begin.

    Lanes are counted, and ds is measured, as seen by the entity that a position is relative to, or
    along the road.
    """
    place = BodyPlace()
    a, b = tables.reals[reals + _X], tables.reals[reals + _X + 1]
    frame = tables.wholes[wholes + _FRAME]
    place.leg = -1
    if frame == _FIXED:
        place.x = a
        place.y = b
        place.z = tables.reals[reals + _X + 2]
        place.heading = tables.reals[reals + _HEADING]
        place.pitch = tables.reals[reals + _HEADING + 1]
        place.roll = tables.reals[reals + _HEADING + 2]
        place.s = tables.reals[reals + _S]
        place.t = tables.reals[reals + _S + 1]
        place.offset = tables.reals[reals + _S + 2]
        place.road = tables.wholes[wholes + _ROAD]
        place.lane = tables.wholes[wholes + _ROAD + 1]
        if place.road < 0:
            place.s = place.x
            place.t = place.y
        return posed_place(roads, place, False)
    place = place_of(bodies, slot, tables.wholes[wholes + _ENTITY])
    base = place.heading
    on_road = place.road >= 0 and frame >= RelativeFrame.ROAD
    sign = direction_of(place.turn)
    if tables.wholes[wholes + _LANES + 2] != 0:
        sign = 1
    if on_road:
        if frame == RelativeFrame.ROAD:
            middle = lane_centre(roads, place.road, place.lane, place.s)
            place.offset = place.t - middle[0] + b
        else:
            place.lane = lane_counted(place.lane, sign * tables.wholes[wholes + _LANES])
            place.offset = b
        place.turn = wp.where(sign > 0, ZERO, PI)
        further = wp.where(frame == RelativeFrame.LANE_LENGTH, ZERO, a)
        place = moved_place(roads, tables.leg_roads, wp.vec2i(0, 0), place, a - further, further)
    elif frame == RelativeFrame.WORLD:
        place.x += a
        place.y += b
        place.z += tables.reals[reals + _X + 2]
    else:
        cosine, sine = portable_cos(base), portable_sin(base)
        place.x += a * cosine - b * sine
        place.y += a * sine + b * cosine
        place.z += tables.reals[reals + _X + 2]
    if not on_road:
        place = found_place(roads, place)
    place = posed_place(roads, place, on_road)
    if on_road:
        base = place.heading
    own = tables.reals[reals + _HEADING]
    place.heading = own
    if tables.wholes[wholes + _LANES + 1] != 0:
        place.heading = wrapped(base + own)
    if place.road >= 0:
        middle = lane_centre(roads, place.road, place.lane, place.s)
        place.turn = wrapped(place.heading - place.road_heading - portable_atan2(middle[1], ONE))
    return place
