"""Warp functions: one step of the actions of a body."""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_cos, portable_sin
from twin.road.walk.road_arrays import RoadArrays
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, PlayArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.begin import (
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
    start_follow,
)
from twin.scenario.storyboard.interpreter.distances import gap_now, step_aside, step_gap
from twin.scenario.storyboard.interpreter.ground import (
    BodyPlace,
    direction_of,
    wrapped,
)
from twin.scenario.storyboard.interpreter.laterals import (
    LANE,
    OVER,
    step_lane_change,
    step_offset,
)
from twin.scenario.storyboard.interpreter.speeds import REACHED, step_profile, step_speed
from twin.scenario.storyboard.interpreter.synchronise import along_way, step_synchronise, way_left
from twin.scenario.storyboard.interpreter.transition import CLOSE, PI, ZERO, sign_of
from twin.scenario.storyboard.interpreter.ways import (
    way_at_time,
    way_length,
    way_place,
    way_row,
    way_times,
)
from twin.scenario.storyboard.player.columns import (
    Domain,
    InstanceColumn,
    ProgramColumn,
    Real,
    Whole,
)
from twin.scenario.storyboard.player.layout import real_column, whole_column
from twin.scenario.storyboard.program import actions as records

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

_MASTER = whole_column(records.SynchronizeAction, "master")
_TIMED = whole_column(records.FollowTrajectoryAction, "timed")
_ABSOLUTE = whole_column(records.FollowTrajectoryAction, "absolute_time")
_SCALE = real_column(records.FollowTrajectoryAction, "time_scale")
_LATER = real_column(records.FollowTrajectoryAction, "time_offset_s")
_BOTH = wp.constant(wp.int32(Domain.LONGITUDINAL | Domain.LATERAL))

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
    program: wp.int32,
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
    if now.wholes[slot, e, Whole.TRAJECTORY] < 0:
        start_follow(tables, now, play, slot, program, e, k, reals, wholes)
    way = way_row(tables, now, slot, program, e)
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
        heading = way_place(tables, now, slot, e, way, s).heading
        heads = sign_of(portable_cos(place.heading - heading))
        along = sign_of(speed) * heads
        target = s + along * wp.abs(speed) * step_s
        if closed:
            target = target - wp.floor(target / length) * length
        elif (along > ZERO and target > length - CLOSE) or (along < ZERO and target < CLOSE):
            if wp.abs(speed) * step_s > ZERO:
                result.over = 1
                rest = wp.where(along > ZERO, target - length, -target)
            target = wp.clamp(target, ZERO, length)
    point = way_place(tables, now, slot, e, way, target)
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


@wp.struct
class BodyMotion:
    """What the actions of a body have made of its step so far."""

    place: BodyPlace
    speed: wp.float64
    mode: wp.int32
    claimed: wp.int32
    """Bits of what actions have moved, so that the default controller does not."""
    ahead: wp.float64
    """Way along the road that is still to be gone [m]."""
    changing: wp.int32
    """Instance of a lane change, -1: none."""
    over: wp.int32
    """1: the action of the last call is at its end."""


@wp.func
def step_speeds(
    tables: ProgramArrays,
    before: BodyArrays,
    now: BodyArrays,
    roads: RoadArrays,
    play: PlayArrays,
    slot: wp.int32,
    program: wp.int32,
    e: wp.int32,
    k: wp.int32,
    motion: BodyMotion,
    step_s: wp.float64,
) -> BodyMotion:
    """A step of an action that sets the speed and leaves the way to others."""
    instance = tables.programs[program, ProgramColumn.INSTANCE] + k
    kind = tables.instances[instance, InstanceColumn.KIND]
    reals = tables.instances[instance, InstanceColumn.REALS]
    wholes = tables.instances[instance, InstanceColumn.WHOLES]
    row = tables.programs[program, ProgramColumn.ENTITY] + e
    speed = wp.float64(motion.speed)
    if kind == SPEED:
        speed = step_speed(tables, before, play, slot, k, row, reals, wholes, speed, step_s)
        motion.over = play.instance_wholes[slot, k, REACHED]
    elif kind == PROFILE:
        speed = step_profile(tables, play, slot, k, reals, wholes, step_s)
        motion.over = play.instance_wholes[slot, k, REACHED]
    else:
        master = tables.wholes[wholes + _MASTER]
        left = way_left(tables, now, roads, play, slot, k, e, 0, reals, wholes)
        master_left = way_left(tables, before, roads, play, slot, k, master, 1, reals, wholes)
        along = along_way(before, slot, e)
        master_along = along_way(before, slot, master)
        speed = step_synchronise(
            tables, before, play, slot, k, reals, wholes, speed, along, left, master_left,
            master_along, step_s,
        )  # fmt: skip
        motion.over = play.instance_wholes[slot, k, OVER]
    motion.speed = speed
    return motion


@wp.func
def step_gaps(
    tables: ProgramArrays,
    before: BodyArrays,
    roads: RoadArrays,
    play: PlayArrays,
    slot: wp.int32,
    program: wp.int32,
    e: wp.int32,
    k: wp.int32,
    motion: BodyMotion,
    step_s: wp.float64,
) -> BodyMotion:
    """A step of keeping a distance."""
    instance = tables.programs[program, ProgramColumn.INSTANCE] + k
    reals = tables.instances[instance, InstanceColumn.REALS]
    wholes = tables.instances[instance, InstanceColumn.WHOLES]
    base = tables.programs[program, ProgramColumn.ENTITY]
    aside = tables.instances[instance, InstanceColumn.KIND] == ASIDE
    gap = gap_now(tables, before, roads, slot, base, e, wholes, aside)
    if aside:
        wish = step_aside(tables, play, slot, k, reals, wholes, gap, step_s)
        sign = wp.float64(direction_of(motion.place.turn))
        motion.place.offset = motion.place.offset + sign * wish.ahead
    else:
        speed = wp.float64(motion.speed)
        wish = step_gap(tables, before, play, slot, k, reals, wholes, speed, gap, step_s)
        motion.ahead = motion.ahead + wish.ahead
        motion.speed = wish.speed
    motion.mode = wp.int32(ON_ROAD)
    motion.over = play.instance_wholes[slot, k, OVER]
    return motion


@wp.func
def step_laterals(
    tables: ProgramArrays,
    before: BodyArrays,
    play: PlayArrays,
    slot: wp.int32,
    program: wp.int32,
    k: wp.int32,
    motion: BodyMotion,
    step_s: wp.float64,
) -> BodyMotion:
    """A step of a lane change or of a lane offset."""
    instance = tables.programs[program, ProgramColumn.INSTANCE] + k
    reals = tables.instances[instance, InstanceColumn.REALS]
    wholes = tables.instances[instance, InstanceColumn.WHOLES]
    speed = wp.float64(motion.speed)
    if tables.instances[instance, InstanceColumn.KIND] == LANE_CHANGE:
        turn = wp.float64(motion.place.turn)
        change = step_lane_change(tables, play, slot, k, wholes, speed, turn, step_s)
        motion.claimed = motion.claimed | _BOTH
        if change.moves != 0 and motion.place.road >= 0:
            motion.place.lane = play.instance_wholes[slot, k, LANE]
            motion.place.offset = change.offset
            motion.place.turn = change.turn
            motion.ahead = motion.ahead + change.ahead
            motion.mode = wp.int32(ON_ROAD)
            motion.changing = k
    else:
        shift = step_offset(
            tables, before, play, slot, k, reals, wholes, motion.place, speed, step_s
        )
        motion.place.offset = shift.offset
        motion.place.turn = shift.turn
        motion.claimed = motion.claimed | wp.int32(Domain.LATERAL)
        motion.mode = wp.int32(ON_ROAD)
    motion.over = play.instance_wholes[slot, k, OVER]
    return motion


@wp.func
def step_action(
    tables: ProgramArrays,
    before: BodyArrays,
    now: BodyArrays,
    roads: RoadArrays,
    play: PlayArrays,
    slot: wp.int32,
    program: wp.int32,
    e: wp.int32,
    k: wp.int32,
    motion: BodyMotion,
    controlled: wp.int32,
    step: wp.int32,
    step_s: wp.float64,
) -> BodyMotion:
    """A step of any action; what a controller has is left to it, and a speed action then ends."""
    instance = tables.programs[program, ProgramColumn.INSTANCE] + k
    kind = tables.instances[instance, InstanceColumn.KIND]
    domains = tables.instances[instance, InstanceColumn.DOMAINS]
    motion.over = 0
    if kind == FOLLOW:
        domains = wp.int32(Domain.LATERAL)
    if domains & controlled != 0:
        motion.over = wp.where(kind == SPEED, 1, 0)
    elif kind == SPEED or kind == PROFILE or kind == SYNCHRONISE:
        motion = step_speeds(tables, before, now, roads, play, slot, program, e, k, motion, step_s)
    elif kind == GAP or kind == ASIDE:
        motion = step_gaps(tables, before, roads, play, slot, program, e, k, motion, step_s)
    elif kind == LANE_CHANGE or kind == OFFSET:
        motion = step_laterals(tables, before, play, slot, program, k, motion, step_s)
    elif kind == FOLLOW:
        reals = tables.instances[instance, InstanceColumn.REALS]
        wholes = tables.instances[instance, InstanceColumn.WHOLES]
        timed = controlled & wp.int32(Domain.LONGITUDINAL) == 0
        speed = wp.float64(motion.speed)
        follow = step_follow(
            tables, now, play, slot, program, e, k, reals, wholes, motion.place, speed, timed,
            step, step_s,
        )  # fmt: skip
        motion.place = follow.place
        motion.speed = follow.speed
        motion.over = follow.over
        motion.claimed = motion.claimed | _BOTH
        motion.mode = wp.int32(FREE)
    return motion
