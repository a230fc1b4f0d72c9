"""The kernel that begins actions: what they do at once, and what they remember."""

from __future__ import annotations

import warp as wp

from twin.road.walk.road_arrays import RoadArrays
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, PlayArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.distances import gap_now, start_gap
from twin.scenario.storyboard.interpreter.ground import (
    BodyPlace,
    controlled_by,
    direction_of,
    found_place,
    keep_place,
    place_of,
    posed_place,
    resolved_place,
    wrapped,
)
from twin.scenario.storyboard.interpreter.laterals import start_lane_change, start_offset
from twin.scenario.storyboard.interpreter.speeds import start_profile, start_speed
from twin.scenario.storyboard.interpreter.synchronise import start_synchronise
from twin.scenario.storyboard.interpreter.transition import PI, ZERO
from twin.scenario.storyboard.interpreter.ways import way_place, way_row
from twin.scenario.storyboard.player.columns import (
    Domain,
    EntityWhole,
    InstanceColumn,
    InstanceState,
    ProgramColumn,
    Real,
    SlotColumn,
    Whole,
)
from twin.scenario.storyboard.player.kinds import action_code
from twin.scenario.storyboard.player.layout import layout_of, real_column, whole_column
from twin.scenario.storyboard.program import actions as records

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

SPEED = action_code(records.SpeedAction)
PROFILE = action_code(records.SpeedProfileAction)
GAP = action_code(records.LongitudinalDistanceAction)
LANE_CHANGE = action_code(records.LaneChangeAction)
OFFSET = action_code(records.LaneOffsetAction)
ASIDE = action_code(records.LateralDistanceAction)
SYNCHRONISE = action_code(records.SynchronizeAction)
TELEPORT = action_code(records.TeleportAction)
ROUTE = action_code(records.AssignRouteAction)
ACQUIRE = action_code(records.AcquirePositionAction)
FOLLOW = action_code(records.FollowTrajectoryAction)
CONTROLLER = action_code(records.ControllerAction)
VISIBILITY = action_code(records.VisibilityAction)
LIGHT = action_code(records.LightAction)
CONNECT = action_code(records.ConnectTrailerAction)
DISCONNECT = action_code(records.DisconnectTrailerAction)
ADD = action_code(records.AddEntityAction)

_TELEPORT_REALS = real_column(records.TeleportAction, "position.x_m")
_TELEPORT_WHOLES = whole_column(records.TeleportAction, "position.frame")
_ADD_REALS = real_column(records.AddEntityAction, "position.x_m")
_ADD_WHOLES = whole_column(records.AddEntityAction, "position.frame")
_SYNC_REALS = real_column(records.SynchronizeAction, "position.x_m")
_SYNC_WHOLES = whole_column(records.SynchronizeAction, "position.frame")
_MASTER_REALS = real_column(records.SynchronizeAction, "master_position.x_m")
_MASTER_WHOLES = whole_column(records.SynchronizeAction, "master_position.frame")
_ROUTE_INDEX = whole_column(records.AssignRouteAction, "route")
_ACQUIRE_COUNT = whole_column(records.AcquirePositionAction, "routes.tail")
_ACQUIRE_FIRST = len(layout_of(records.AcquirePositionAction).wholes)
_WAY = whole_column(records.FollowTrajectoryAction, "trajectory")
_WAY_TIMED = whole_column(records.FollowTrajectoryAction, "timed")
_WAY_S = real_column(records.FollowTrajectoryAction, "initial_distance_m")
_LATERAL = whole_column(records.ControllerAction, "lateral")
_LONGITUDINAL = whole_column(records.ControllerAction, "longitudinal")
_MODEL = whole_column(records.ControllerAction, "model")
_TRAILER = whole_column(records.ConnectTrailerAction, "trailer")
_GRAPHICS = whole_column(records.VisibilityAction, "graphics")
_LAMP = whole_column(records.LightAction, "light")
_LAMP_MODE = whole_column(records.LightAction, "mode")

WAY_TIME = 0
"""Scratch of a trajectory: time since the action began."""
WAY_SIGN = 0
"""Scratch of a trajectory: -1 of a body that goes along it backwards."""
_EVERYONE = wp.constant(wp.int32(7))


@wp.func
def start_route(
    tables: ProgramArrays,
    now: BodyArrays,
    slot: wp.int32,
    program: wp.int32,
    e: wp.int32,
    route: wp.int32,
):
    """Follow a route from the first of its legs that is on the body's road."""
    row = tables.programs[program, ProgramColumn.ROUTE] + route
    now.wholes[slot, e, Whole.ROUTE] = route
    leg = wp.int32(0)
    for back in range(tables.routes[row, 1]):
        at = tables.routes[row, 1] - 1 - back
        if tables.leg_roads[tables.routes[row, 0] + at] == now.wholes[slot, e, Whole.ROAD]:
            leg = at
    now.wholes[slot, e, Whole.LEG] = leg


@wp.func
def start_simple(
    tables: ProgramArrays,
    now: BodyArrays,
    slot: wp.int32,
    program: wp.int32,
    e: wp.int32,
    kind: wp.int32,
    wholes: wp.int32,
):
    """Actions that are over at once and put nobody anywhere."""
    if kind == ROUTE:
        start_route(tables, now, slot, program, e, tables.wholes[wholes + _ROUTE_INDEX])
    elif kind == ACQUIRE:
        against = wp.where(direction_of(now.reals[slot, e, Real.TURN]) > 0, 0, 1)
        at = 2 * now.wholes[slot, e, Whole.ROAD] + against
        if at >= 0 and at < tables.wholes[wholes + _ACQUIRE_COUNT]:
            route = tables.wholes[wholes + _ACQUIRE_FIRST + at]
            if route >= 0:
                start_route(tables, now, slot, program, e, route)
    elif kind == CONNECT:
        now.wholes[slot, e, Whole.TOWS] = tables.wholes[wholes + _TRAILER]
    elif kind == DISCONNECT:
        now.wholes[slot, e, Whole.TOWS] = -1
    elif kind == CONTROLLER:
        bits = now.wholes[slot, e, Whole.CONTROLLED]
        for domain in range(2):
            column = wp.where(domain == 0, _LONGITUDINAL, _LATERAL)
            bit = wp.where(domain == 0, wp.int32(Domain.LONGITUDINAL), wp.int32(Domain.LATERAL))
            active = tables.wholes[wholes + column]
            if active == 1:
                bits = bits | bit
            elif active == 0:
                bits = bits & ~bit
        now.wholes[slot, e, Whole.CONTROLLED] = bits
        if tables.wholes[wholes + _MODEL] >= 0:
            now.wholes[slot, e, Whole.MODEL] = tables.wholes[wholes + _MODEL]
    elif kind == VISIBILITY:
        seen = wp.int32(0)
        for k in range(3):
            seen = seen | (tables.wholes[wholes + _GRAPHICS + k] << k)
        now.wholes[slot, e, Whole.VISIBLE] = seen
    elif kind == LIGHT:
        shift = 2 * tables.wholes[wholes + _LAMP]
        lights = now.wholes[slot, e, Whole.LIGHTS] & ~(3 << shift)
        lights = lights | (tables.wholes[wholes + _LAMP_MODE] << shift)
        now.wholes[slot, e, Whole.LIGHTS] = lights


@wp.func
def start_follow(
    tables: ProgramArrays,
    now: BodyArrays,
    play: PlayArrays,
    slot: wp.int32,
    program: wp.int32,
    e: wp.int32,
    k: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
) -> BodyPlace:
    """Put a body on its trajectory; backwards if it drives backwards and times do not say more."""
    s = tables.reals[reals + _WAY_S]
    now.wholes[slot, e, Whole.TRAJECTORY] = tables.wholes[wholes + _WAY]
    way = way_row(tables, now, slot, program, e)
    now.reals[slot, e, Real.WAY] = s
    now.reals[slot, e, Real.WAY_X] = now.reals[slot, e, Real.X]
    now.reals[slot, e, Real.WAY_Y] = now.reals[slot, e, Real.Y]
    now.reals[slot, e, Real.WAY_Z] = now.reals[slot, e, Real.Z]
    now.reals[slot, e, Real.WAY_HEADING] = now.reals[slot, e, Real.HEADING]
    point = way_place(tables, now, slot, e, way, s)
    sign = wp.int32(1)
    if tables.wholes[wholes + _WAY_TIMED] != 0:
        now.reals[slot, e, Real.SPEED] = point.speed
    elif now.reals[slot, e, Real.SPEED] < ZERO:
        sign = -1
    play.instance_reals[slot, k, WAY_TIME] = ZERO
    play.instance_wholes[slot, k, WAY_SIGN] = sign
    place = place_of(now, slot, e)
    place.x = point.x
    place.y = point.y
    place.z = point.z
    place.heading = wrapped(point.heading + wp.where(sign < 0, PI, ZERO))
    return place


@wp.func
def follows(
    tables: ProgramArrays,
    play: PlayArrays,
    slot: wp.int32,
    instance0: wp.int32,
    first: wp.int32,
    end: wp.int32,
) -> wp.bool:
    """True if any of a body's instances, ``first`` to ``end`` - 1, follows a trajectory."""
    for at in range(first, end):
        k = tables.actor_instances[at]
        if play.instance_states[slot, k] == InstanceState.RUNNING:
            if tables.instances[instance0 + k, InstanceColumn.KIND] == FOLLOW:
                return True
    return False


@wp.func
def appear(now: BodyArrays, slot: wp.int32, e: wp.int32):
    """A body that was nowhere is seen by everyone."""
    if now.wholes[slot, e, Whole.PRESENT] == 0:
        now.wholes[slot, e, Whole.PRESENT] = 1
        now.wholes[slot, e, Whole.VISIBLE] = _EVERYONE


@wp.kernel
def begin_kernel(
    # model
    tables: ProgramArrays,
    roads: RoadArrays,
    # args
    only: wp.int32,
    level: wp.int32,
    # state in
    before: BodyArrays,
    # state in and out
    now: BodyArrays,
    play: PlayArrays,
):
    """Begin what is to begin, one thread per slot and body.

    ``level`` -1: all actions; else those of Init of that round. Bodies are read from ``before``,
    so no order of threads matters; each thread writes its own in ``now``.
    """
    slot, e = wp.tid()
    if (only >= 0 and slot != only) or play.slots[slot, SlotColumn.RUNNING] == 0:
        return
    program = play.slots[slot, SlotColumn.PROGRAM]
    base = tables.programs[program, ProgramColumn.ENTITY]
    if e >= tables.programs[program, ProgramColumn.ENTITIES]:
        return
    row = base + e
    first = tables.entity_wholes[row, EntityWhole.LIST]
    end = first + tables.entity_wholes[row, EntityWhole.LIST_COUNT]
    instance0 = tables.programs[program, ProgramColumn.INSTANCE]
    controlled = controlled_by(now, slot, e)
    for at in range(first, end):
        k = tables.actor_instances[at]
        begins = play.instance_states[slot, k] == InstanceState.STARTING
        if level >= 0 and tables.instances[instance0 + k, InstanceColumn.LEVEL] != level:
            begins = False
        if begins:
            kind = tables.instances[instance0 + k, InstanceColumn.KIND]
            reals = tables.instances[instance0 + k, InstanceColumn.REALS]
            wholes = tables.instances[instance0 + k, InstanceColumn.WHOLES]
            domains = tables.instances[instance0 + k, InstanceColumn.DOMAINS]
            if kind == TELEPORT:
                domains = 0
            state = wp.int32(InstanceState.RUNNING)
            if kind >= TELEPORT and kind != FOLLOW:
                state = wp.int32(InstanceState.FINISHED)
            free = domains & controlled == 0
            if kind == SPEED and not free:
                state = wp.int32(InstanceState.FINISHED)
            speed = wp.float64(now.reals[slot, e, Real.SPEED])
            place = place_of(now, slot, e)
            if kind == SPEED and free:
                speed = start_speed(tables, before, play, slot, k, row, reals, wholes, speed)
                now.reals[slot, e, Real.SPEED] = speed
            elif kind == PROFILE:
                start_profile(tables, before, play, slot, k, wholes, speed)
            elif kind == GAP or kind == ASIDE:
                aside = kind == ASIDE
                gap = gap_now(tables, before, roads, slot, base, e, wholes, aside)
                start_gap(tables, play, slot, k, wholes, aside, gap)
            elif kind == LANE_CHANGE:
                start_lane_change(tables, before, roads, play, slot, k, reals, wholes, place)
                if free:
                    place.turn = wp.where(direction_of(place.turn) > 0, ZERO, PI)
                    keep_place(now, slot, e, place)
            elif kind == OFFSET:
                start_offset(tables, before, play, slot, k, reals, wholes, place)
            elif kind == FOLLOW and free:
                place = start_follow(tables, now, play, slot, program, e, k, reals, wholes)
                place = found_place(roads, place)
                place = posed_place(roads, place, False)
                keep_place(now, slot, e, place)
                appear(now, slot, e)
            elif kind == FOLLOW:
                # Something else moves the body: it is put there once it is let go.
                now.wholes[slot, e, Whole.TRAJECTORY] = -1
            elif kind == TELEPORT or kind == ADD or kind == SYNCHRONISE:
                places = wp.where(kind == SYNCHRONISE, 2, 1)
                for which in range(places):
                    first_real = _TELEPORT_REALS
                    first_whole = _TELEPORT_WHOLES
                    if kind == ADD:
                        first_real = _ADD_REALS
                        first_whole = _ADD_WHOLES
                    elif kind == SYNCHRONISE:
                        first_real = wp.where(which == 0, _SYNC_REALS, _MASTER_REALS)
                        first_whole = wp.where(which == 0, _SYNC_WHOLES, _MASTER_WHOLES)
                    target = resolved_place(
                        tables, before, roads, slot, reals + first_real, wholes + first_whole
                    )
                    if kind == SYNCHRONISE:
                        start_synchronise(play, slot, k, which, target)
                    else:
                        target.leg = now.wholes[slot, e, Whole.LEG]
                        keep_place(now, slot, e, target)
                        if not follows(tables, play, slot, instance0, first, end):
                            now.wholes[slot, e, Whole.TRAJECTORY] = -1
                        now.wholes[slot, e, Whole.JUMPED] = 1
                        appear(now, slot, e)
            else:
                start_simple(tables, now, slot, program, e, kind, wholes)
            play.instance_states[slot, k] = state
