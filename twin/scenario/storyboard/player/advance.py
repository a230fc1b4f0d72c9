"""The kernel that moves bodies by one step: running actions, then the default controller.

The default controller keeps speed, lane and offset (ASAM OpenSCENARIO XML 1.3, section 6.6.1);
it moves by the new speed times the step, measured at the body's own t, and keeps the body's
heading relative to the road. A body that has no road moves along its heading.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_cos, portable_sin
from twin.road.walk.road_arrays import RoadArrays
from twin.scenario.storyboard.player.arrays import BodyArrays, PlayArrays, ProgramArrays
from twin.scenario.storyboard.player.begin import (
    ASIDE,
    FOLLOW,
    GAP,
    LANE_CHANGE,
    OFFSET,
    PROFILE,
    SPEED,
    SYNCHRONISE,
    WAY_SIGN,
    WAY_TIME,
)
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
from twin.scenario.storyboard.player.distances import gap_now, step_aside, step_gap
from twin.scenario.storyboard.player.ground import (
    BodyPlace,
    direction_of,
    found_place,
    keep_place,
    moved_place,
    place_of,
    posed_place,
    snapped_lane,
    wrapped,
)
from twin.scenario.storyboard.player.laterals import (
    LANE,
    OVER,
    step_lane_change,
    step_offset,
)
from twin.scenario.storyboard.player.layout import real_column, whole_column
from twin.scenario.storyboard.player.speeds import REACHED, step_profile, step_speed
from twin.scenario.storyboard.player.synchronise import along_way, step_synchronise, way_left
from twin.scenario.storyboard.player.transition import CLOSE, PI, ZERO, sign_of
from twin.scenario.storyboard.player.ways import way_at_time, way_length, way_place, way_times
from twin.scenario.storyboard.program import actions as records

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

_MASTER = whole_column(records.SynchronizeAction, "master")
_TIMED = whole_column(records.FollowTrajectoryAction, "timed")
_ABSOLUTE = whole_column(records.FollowTrajectoryAction, "absolute_time")
_SCALE = real_column(records.FollowTrajectoryAction, "time_scale")
_LATER = real_column(records.FollowTrajectoryAction, "time_offset_s")
_STILL_MPS = wp.constant(wp.float64(1e-3))
"""Bodies that are slower stand still [m/s]."""
_SQUARE = wp.constant(wp.float64(1.5707963267948966))

STAYS = 0
ON_ROAD = 1
FREE = 2
"""How a body's place follows: it stays, from lane, s and offset, or from its pose."""


@wp.struct
class WayStep:
    """A step along a trajectory."""

    place: BodyPlace
    speed: wp.float64
    over: wp.int32


@wp.func
def step_follow(
    tables: ProgramArrays,
    now: BodyArrays,
    play: PlayArrays,
    slot: wp.int32,
    e: wp.int32,
    k: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
    place: BodyPlace,
    speed: wp.float64,
    longitudinal: wp.bool,
    step: wp.int32,
    step_s: wp.float64,
) -> WayStep:
    """A step along a trajectory, by its times or by the body's speed.

    A time t of the scenario or since the action began is that of the trajectory's time
    (t - offset) / scale. What is left of the step at the end of the trajectory goes straight on.
    """
    result = WayStep()
    way = now.wholes[slot, e, Whole.TRAJECTORY]
    s = now.reals[slot, e, Real.WAY]
    length = way_length(tables, way)
    closed = tables.trajectories[way, 2] != 0
    sign = wp.float64(play.instance_wholes[slot, k, WAY_SIGN])
    rest = wp.float64(0.0)
    target = wp.float64(s)
    result.speed = speed
    if tables.wholes[wholes + _TIMED] != 0 and longitudinal:
        time = play.instance_reals[slot, k, WAY_TIME] + step_s
        play.instance_reals[slot, k, WAY_TIME] = time
        if tables.wholes[wholes + _ABSOLUTE] != 0:
            time = wp.float64(step + 1) * step_s
        time = (time - tables.reals[reals + _LATER]) / tables.reals[reals + _SCALE]
        target = way_at_time(tables, way, time)
        end = way_times(tables, way)[1]
        if time >= end - CLOSE:
            result.over = 1
            rest = wp.max(time - end, ZERO) * tables.reals[reals + _SCALE] * wp.abs(speed)
        if time < end + CLOSE and step_s > ZERO:
            result.speed = (target - s) / step_s
    else:
        # Forwards along the line if it heads along it, whatever its gear.
        heads = sign_of(portable_cos(place.heading - way_place(tables, now, slot, e, s).heading))
        along = sign_of(speed) * heads
        target = s + along * wp.abs(speed) * step_s
        if closed:
            target = target - wp.floor(target / length) * length
        elif (along > ZERO and target > length - CLOSE) or (along < ZERO and target < CLOSE):
            if wp.abs(speed) * step_s > ZERO:
                result.over = 1
                rest = wp.where(along > ZERO, target - length, -target)
            target = wp.clamp(target, ZERO, length)
    point = way_place(tables, now, slot, e, target)
    now.reals[slot, e, Real.WAY] = target
    place.x = point.x
    place.y = point.y
    place.z = point.z
    place.heading = wrapped(point.heading + wp.where(sign < ZERO, PI, ZERO))
    if result.over != 0 and rest > ZERO:
        on = sign_of(speed) * rest
        place.x += on * portable_cos(place.heading)
        place.y += on * portable_sin(place.heading)
    result.place = place
    return result


@wp.func
def measure(
    now: BodyArrays,
    slot: wp.int32,
    e: wp.int32,
    place: BodyPlace,
    speed: wp.float64,
    driven: wp.bool,
    moved: wp.bool,
    after: wp.int32,
    step_s: wp.float64,
):
    """Velocity, acceleration and what lasts, from the places at both ends of a step."""
    dx = place.x - now.reals[slot, e, Real.OLD_X]
    dy = place.y - now.reals[slot, e, Real.OLD_Y]
    dz = place.z - now.reals[slot, e, Real.OLD_Z]
    cosine, sine = portable_cos(place.heading), portable_sin(place.heading)
    vx, vy = speed * cosine, speed * sine
    vz = wp.float64(0.0)
    jumped = now.wholes[slot, e, Whole.JUMPED] != 0 or step_s == ZERO
    if not jumped and driven:
        vx = dx / step_s
        vy = dy / step_s
        vz = dz / step_s
    ax = wp.float64(0.0)
    ay = wp.float64(0.0)
    az = wp.float64(0.0)
    if not jumped:
        ax = (vx - now.reals[slot, e, Real.VX]) / step_s
        ay = (vy - now.reals[slot, e, Real.VY]) / step_s
        az = (vz - now.reals[slot, e, Real.VZ]) / step_s
        way = wp.sqrt(dx * dx + dy * dy)
        now.reals[slot, e, Real.TRAVELED] = now.reals[slot, e, Real.TRAVELED] + way
    now.reals[slot, e, Real.VX] = vx
    now.reals[slot, e, Real.VY] = vy
    now.reals[slot, e, Real.VZ] = vz
    now.reals[slot, e, Real.AX] = ax
    now.reals[slot, e, Real.AY] = ay
    now.reals[slot, e, Real.AZ] = az
    now.reals[slot, e, Real.ACCELERATION] = ax * cosine + ay * sine
    now.reals[slot, e, Real.SPEED] = speed
    now.reals[slot, e, Real.OLD_X] = place.x
    now.reals[slot, e, Real.OLD_Y] = place.y
    now.reals[slot, e, Real.OLD_Z] = place.z
    now.wholes[slot, e, Whole.JUMPED] = 0
    still = wp.abs(speed) < _STILL_MPS
    off = place.road >= 0 and place.lane == 0
    lasting(now, slot, e, Whole.STILL_SINCE, still, after)
    lasting(now, slot, e, Whole.OFF_SINCE, off, after)
    if moved:
        lasting(now, slot, e, Whole.END_SINCE, place.at_end != 0, after)


@wp.func
def lasting(
    now: BodyArrays, slot: wp.int32, e: wp.int32, column: wp.int32, true: wp.bool, after: wp.int32
):
    """Since which step something is true, -1: it is not."""
    if not true:
        now.wholes[slot, e, column] = -1
    elif now.wholes[slot, e, column] < 0:
        now.wholes[slot, e, column] = after


@wp.kernel
def advance_kernel(
    # model
    tables: ProgramArrays,
    roads: RoadArrays,
    # args
    only: wp.int32,
    step_s: wp.float64,
    # state in
    before: BodyArrays,
    # state in and out
    now: BodyArrays,
    play: PlayArrays,
):
    """Move bodies, one thread per slot and body; others are read from ``before``."""
    slot, e = wp.tid()
    if (only >= 0 and slot != only) or play.slots[slot, SlotColumn.RUNNING] == 0:
        return
    program = play.slots[slot, SlotColumn.PROGRAM]
    base = tables.programs[program, ProgramColumn.ENTITY]
    if e >= tables.programs[program, ProgramColumn.ENTITIES]:
        return
    if now.wholes[slot, e, Whole.PRESENT] == 0:
        return
    step = play.slots[slot, SlotColumn.STEP]
    row = base + e
    first = tables.entity_wholes[row, EntityWhole.LIST]
    end = first + tables.entity_wholes[row, EntityWhole.LIST_COUNT]
    instance0 = tables.programs[program, ProgramColumn.INSTANCE]
    imposed = now.wholes[slot, e, Whole.IMPOSED] != 0
    controlled = now.wholes[slot, e, Whole.CONTROLLED]
    if imposed:
        controlled = wp.int32(Domain.LONGITUDINAL) | wp.int32(Domain.LATERAL)
    place = place_of(now, slot, e)
    speed = wp.float64(now.reals[slot, e, Real.SPEED])
    mode = wp.int32(STAYS)
    claimed = wp.int32(0)
    ahead = wp.float64(0.0)
    changing = wp.int32(-1)
    for at in range(first, end):
        k = tables.actor_instances[at]
        domains = tables.instances[instance0 + k, InstanceColumn.DOMAINS]
        if play.instance_states[slot, k] == InstanceState.RUNNING:
            kind = tables.instances[instance0 + k, InstanceColumn.KIND]
            reals = tables.instances[instance0 + k, InstanceColumn.REALS]
            wholes = tables.instances[instance0 + k, InstanceColumn.WHOLES]
            over = wp.int32(0)
            longitudinal = controlled & wp.int32(Domain.LONGITUDINAL) == 0
            if kind == FOLLOW:
                domains = wp.int32(Domain.LATERAL)
            if domains & controlled != 0:
                over = wp.where(kind == SPEED, 1, 0)
            elif kind == SPEED:
                speed = step_speed(tables, before, play, slot, k, row, reals, wholes, speed, step_s)
                over = play.instance_wholes[slot, k, REACHED]
            elif kind == PROFILE:
                speed = step_profile(tables, play, slot, k, reals, wholes, step_s)
                over = play.instance_wholes[slot, k, REACHED]
            elif kind == GAP or kind == ASIDE:
                aside = kind == ASIDE
                gap = gap_now(tables, before, roads, slot, base, e, wholes, aside)
                if aside:
                    wish = step_aside(tables, play, slot, k, reals, wholes, gap, step_s)
                    sign = wp.float64(direction_of(place.turn))
                    place.offset += sign * wish.ahead
                    mode = wp.int32(ON_ROAD)
                else:
                    wish = step_gap(
                        tables, before, play, slot, k, reals, wholes, speed, gap, step_s
                    )
                    ahead += wish.ahead
                    speed = wish.speed
                    mode = wp.int32(ON_ROAD)
                over = play.instance_wholes[slot, k, OVER]
            elif kind == SYNCHRONISE:
                left = wp.vec2d(ZERO, ZERO)
                for which in range(2):
                    who = wp.where(which == 0, e, tables.wholes[wholes + _MASTER])
                    left[which] = way_left(
                        tables,
                        before,
                        roads,
                        play,
                        slot,
                        k,
                        tables.programs[program, ProgramColumn.TRAJECTORY],
                        who,
                        which,
                        reals,
                        wholes,
                    )
                along = along_way(before, slot, e)
                speed = step_synchronise(
                    tables,
                    before,
                    play,
                    slot,
                    k,
                    reals,
                    wholes,
                    speed,
                    along,
                    left[0],
                    left[1],
                    step_s,
                )
                over = play.instance_wholes[slot, k, OVER]
            elif kind == LANE_CHANGE:
                change = step_lane_change(tables, play, slot, k, wholes, speed, place.turn, step_s)
                claimed = claimed | wp.int32(Domain.LONGITUDINAL) | wp.int32(Domain.LATERAL)
                if change.moves != 0 and place.road >= 0:
                    place.lane = play.instance_wholes[slot, k, LANE]
                    place.offset = change.offset
                    place.turn = change.turn
                    ahead += change.ahead
                    mode = wp.int32(ON_ROAD)
                    changing = k
                over = play.instance_wholes[slot, k, OVER]
            elif kind == OFFSET:
                shift = step_offset(
                    tables, before, play, slot, k, reals, wholes, place, speed, step_s
                )
                place.offset = shift.offset
                place.turn = shift.turn
                claimed = claimed | wp.int32(Domain.LATERAL)
                mode = wp.int32(ON_ROAD)
                over = play.instance_wholes[slot, k, OVER]
            elif kind == FOLLOW:
                follow = step_follow(
                    tables,
                    now,
                    play,
                    slot,
                    e,
                    k,
                    reals,
                    wholes,
                    place,
                    speed,
                    longitudinal,
                    step,
                    step_s,
                )
                place = follow.place
                speed = follow.speed
                over = follow.over
                claimed = claimed | wp.int32(Domain.LONGITUDINAL) | wp.int32(Domain.LATERAL)
                mode = wp.int32(FREE)
            if over != 0:
                play.instance_states[slot, k] = wp.int32(InstanceState.FINISHED)
    if (claimed | controlled) & wp.int32(Domain.LONGITUDINAL) == 0 and wp.abs(speed) > CLOSE:
        ahead += speed * step_s
        if mode == STAYS:
            mode = wp.int32(ON_ROAD)
    if imposed:
        mode = wp.int32(STAYS)
    if mode == ON_ROAD:
        span = wp.vec2i(0, 0)
        route = now.wholes[slot, e, Whole.ROUTE]
        if route >= 0:
            span = wp.vec2i(
                tables.routes[route, 0], tables.routes[route, 0] + tables.routes[route, 1]
            )
        place = moved_place(roads, tables.leg_roads, span, place, ahead, ZERO)
        if changing >= 0:
            play.instance_wholes[slot, changing, LANE] = place.lane
            place = snapped_lane(roads, place)
    elif mode == FREE:
        place = found_place(roads, place)
    if mode != STAYS:
        place = posed_place(roads, place, mode == ON_ROAD)
        keep_place(now, slot, e, place)
    moved = mode == ON_ROAD and wp.abs(ahead) > ZERO
    measure(now, slot, e, place, speed, not imposed, moved, step + 1, step_s)
    if place.at_end != 0:
        now.reals[slot, e, Real.SPEED] = ZERO
