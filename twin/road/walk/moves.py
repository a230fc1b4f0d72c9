"""Warp functions: moving along roads, from lane to lane by their links.

A place that moves is held by its lane and its distance to the left of that lane's middle. Where a
lane section or a road ends it goes on in the lane that follows. Without a lane that follows it
keeps its t inside of a road; at an end of a road it does too if there is a lane, else it stays
there ``at_end``. A place on lane 0, which is none, keeps its distance from the centre line and goes
wherever a road goes on.

In a junction, or wherever several ways lead on, the way to the next road of the route counts; then
those to which a lane link leads, of them those that the file tells for this direction, of them the
one whose heading changes least, of them the first.
"""

from __future__ import annotations

import warp as wp

from twin.road.walk.lanes import centre_in, lane_in, lane_row, section_row
from twin.road.walk.road_arrays import RoadArrays
from twin.road.walk.spots import ONE, SECTION, ZERO, road_curvature, road_length

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

CROSSINGS_MAX = 64
"""Borders of lane sections and ends of roads that one move passes; there it stops ``at_end``."""

_CROSSINGS_MAX = wp.constant(wp.int32(CROSSINGS_MAX))
_SHARE_MIN = wp.constant(wp.float64(0.05))
"""Least length of a way beside a reference line, per metre of that line."""
_TURN_TIE_RAD = wp.constant(wp.float64(1e-6))
"""Headings that change by so little more do not count as different."""


@wp.struct
class RoadMove:
    """A place on a road that moves; make it with :func:`move_on_lane` or :func:`move_at`."""

    road: wp.int32
    """-1: flat ground."""
    lane: wp.int32
    """0: on none."""
    s: wp.float64
    offset: wp.float64
    """To the left of the lane's middle, as seen along s [m]."""
    t: wp.float64
    slope: wp.float64
    """dt/ds of the lane's middle."""
    sign: wp.int32
    """The way it moves by positive distances: 1 along s, -1 against it."""
    route_at: wp.int32
    """Index of its road in the route."""
    at_end: wp.int32
    """1: the last move met the end of the network."""
    rest: wp.float64
    """What the last move left of its distance, along the reference line [m]."""


@wp.func
def move_on_lane(
    roads: RoadArrays,
    road: wp.int32,
    lane: wp.int32,
    s: wp.float64,
    offset: wp.float64,
    sign: wp.int32,
) -> RoadMove:
    """A place ``offset`` to the left of the middle of a lane; on the flat ground that is t."""
    move = RoadMove()
    move.road = road
    move.lane = lane
    move.s = s
    move.offset = offset
    move.sign = sign
    move.t = offset
    if road >= 0:
        middle = centre_in(roads, road, section_row(roads, road, s), lane, s)
        move.t = middle[0] + offset
        move.slope = middle[1]
    return move


@wp.func
def move_at(
    roads: RoadArrays, road: wp.int32, s: wp.float64, t: wp.float64, sign: wp.int32
) -> RoadMove:
    """A place at s, t, on the lane in which it lies."""
    if road < 0:
        return move_on_lane(roads, road, 0, s, t, sign)
    section = section_row(roads, road, s)
    lane = lane_in(roads, road, section, s, t)
    middle = centre_in(roads, road, section, lane, s)
    return move_on_lane(roads, road, lane, s, t - middle[0], sign)


@wp.func
def move_across(roads: RoadArrays, place: RoadMove, t: wp.float64) -> RoadMove:
    """``place`` at another t of its station, on the lane in which that lies: a step of a change of
    lanes. Its way and its route stay."""
    move = move_at(roads, place.road, place.s, t, place.sign)
    move.route_at = place.route_at
    move.at_end = place.at_end
    move.rest = place.rest
    return move


@wp.func
def way_lane(roads: RoadArrays, way: wp.int32, lane: wp.int32) -> wp.int32:
    """The lane to which a lane leads by a way, 0: none."""
    first, end = roads.ways[way, 3], roads.ways[way + 1, 3]
    for row in range(first, end):
        if roads.way_lanes[row, 0] == lane:
            return roads.way_lanes[row, 1]
    return 0


@wp.func
def route_step(
    route: wp.array(dtype=wp.int32), span: wp.vec2i, route_at: wp.int32, road: wp.int32
) -> wp.int32:
    """1 if a road is the next of the route, -1 if it is the one before, else 0."""
    if span[0] >= span[1]:
        return 0
    here = wp.clamp(route_at, span[0], span[1] - 1)
    after, before = wp.min(here + 1, span[1] - 1), wp.max(here - 1, span[0])
    if after != here and route[after] == road:
        return 1
    if before != here and route[before] == road:
        return -1
    return 0


@wp.func
def way_on(
    roads: RoadArrays,
    route: wp.array(dtype=wp.int32),
    span: wp.vec2i,
    route_at: wp.int32,
    end: wp.int32,
    lane: wp.int32,
) -> wp.vec2i:
    """The way on from an end of a road, -1: none, and the index in the route there.

    Args:
        roads: the network.
        route: roads by number.
        span: where the mover's part of it begins and ends; equal: no route.
        route_at: where the mover is in it.
        end: 2 r, or 2 r + 1 at the end of road r.
        lane: the lane it is left on.
    """
    first, last = roads.way_first[end], roads.way_first[end + 1]
    best = wp.int32(-1)
    best_rank = wp.int32(6)
    best_turn = ZERO
    at = route_at
    for way in range(first, last):
        road = roads.ways[way, 0]
        rank = wp.where(way_lane(roads, way, lane) != 0, 2, 4) + 1 - roads.ways[way, 2]
        step = route_step(route, span, route_at, road)
        if step != 0:
            rank = wp.where(step > 0, 0, 1)
        turn = roads.way_turns[way]
        if rank < best_rank or (rank == best_rank and turn < best_turn - _TURN_TIE_RAD):
            best = way
            best_rank = rank
            best_turn = turn
            at = route_at + step
    return wp.vec2i(best, at)


@wp.func
def into_section(roads: RoadArrays, move: RoadMove, along: wp.int32, section: wp.int32) -> RoadMove:
    """Over the border of a lane section of the same road."""
    beyond = section + along
    border = roads.section_starts[wp.max(section, beyond)]
    move.s = border
    if move.lane == 0:
        return move
    row = lane_row(roads, section, move.lane)
    target = wp.int32(0)
    if row >= 0:
        target = roads.lanes[row, wp.where(along > 0, 5, 4)]
    if target == 0:
        t = centre_in(roads, move.road, section, move.lane, border)[0] + move.offset
        target = lane_in(roads, move.road, beyond, border, t)
        move.offset = t - centre_in(roads, move.road, beyond, target, border)[0]
    move.lane = target
    return move


@wp.func
def into_road(
    roads: RoadArrays,
    route: wp.array(dtype=wp.int32),
    span: wp.vec2i,
    move: RoadMove,
    along: wp.int32,
    section: wp.int32,
) -> RoadMove:
    """Over the end of a road; ``at_end`` if it does not go on."""
    length = road_length(roads, move.road)
    move.s = wp.where(along > 0, length, ZERO)
    end = 2 * move.road + wp.where(along > 0, 1, 0)
    choice = way_on(roads, route, span, move.route_at, end, move.lane)
    if choice[0] < 0:
        move.at_end = 1
        return move
    road, contact = roads.ways[choice[0], 0], roads.ways[choice[0], 1]
    turned = wp.where((contact == 1) == (along > 0), -1, 1)
    s = wp.where(contact == 1, road_length(roads, road), ZERO)
    there = section_row(roads, road, s)
    target = wp.int32(0)
    offset = move.offset * wp.float64(turned)
    if move.lane != 0:
        target = way_lane(roads, choice[0], move.lane)
        if target == 0:
            t = centre_in(roads, move.road, section, move.lane, move.s)[0] + move.offset
            t = t * wp.float64(turned)
            target = lane_in(roads, road, there, s, t)
            offset = t - centre_in(roads, road, there, target, s)[0]
            if target == 0:
                move.at_end = 1
                return move
    move.road = road
    move.s = s
    move.lane = target
    move.offset = offset
    move.sign = move.sign * turned
    move.route_at = choice[1]
    return move


@wp.func
def walk(
    roads: RoadArrays,
    route: wp.array(dtype=wp.int32),
    span: wp.vec2i,
    place: RoadMove,
    distance: wp.float64,
) -> RoadMove:
    """``place`` after a distance along the reference lines, whatever its t."""
    move = place
    forward = wp.where(distance < ZERO, -1, 1)
    rest = wp.abs(distance)
    walking = wp.int32(1)
    section = section_row(roads, move.road, move.s)
    crossed = wp.int32(0)
    while walking == 1 and crossed < _CROSSINGS_MAX:
        crossed += 1
        along = move.sign * forward
        last = roads.roads[move.road + 1, SECTION] - 1
        first = roads.roads[move.road, SECTION]
        inner = section != wp.where(along > 0, last, first)
        border = wp.where(along > 0, road_length(roads, move.road), ZERO)
        if inner:
            border = roads.section_starts[section + wp.where(along > 0, 1, 0)]
        way = wp.max((border - move.s) * wp.float64(along), ZERO)
        # A station between two sections belongs to the second.
        if rest < way or (rest == way and not (inner and along > 0)):
            move.s += rest * wp.float64(along)
            rest = ZERO
            walking = 0
        elif inner:
            rest -= way
            move = into_section(roads, move, along, section)
            section += along
        else:
            rest -= way
            move = into_road(roads, route, span, move, along, section)
            section = section_row(roads, move.road, move.s)
            walking = 1 - move.at_end
    if walking == 1:
        move.at_end = 1
    move.rest = rest
    middle = centre_in(roads, move.road, section, move.lane, move.s)
    move.t = middle[0] + move.offset
    move.slope = middle[1]
    return move


@wp.func
def road_advance(
    roads: RoadArrays,
    route: wp.array(dtype=wp.int32),
    span: wp.vec2i,
    place: RoadMove,
    distance: wp.float64,
) -> RoadMove:
    """``place`` moved by a distance along its own way, negative: backwards.

    At t a way is 1 - k t times as long as the reference line of curvature k. That at the
    beginning counts for the whole distance, which is exact on lines and arcs.

    Args:
        roads: the network.
        route: roads by number, of all movers.
        span: where the mover's part of it begins and ends; equal: no route.
        place: from where; what it says about its last move does not count.
        distance: [m].
    """
    move = place
    move.at_end = 0
    move.rest = ZERO
    if move.road < 0:
        move.s += distance * wp.float64(move.sign)
        move.t = move.offset
        return move
    share = ONE - road_curvature(roads, move.road, move.s) * move.t
    return walk(roads, route, span, move, distance / wp.max(share, _SHARE_MIN))
