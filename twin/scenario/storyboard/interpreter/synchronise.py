"""Warp functions: arriving when another arrives (ASAM OpenSCENARIO XML 1.3, SynchronizeAction).

With s left to go and T until the master arrives, both from the states at the beginning of the step:
without a final speed it accelerates by 2 (s / T - v) / T, evenly up to the arrival. With a final
speed v1 the speed changes at one rate a up to a turning point and at -a from there; the ways of
both parts add up to s and their times to T:

    v_x = (2 s -+ w) / (2 T),  x = (2 v1 T - 2 s -+ w) / (2 (v1 - v)),  a = (v_x - v) / x,
    w = sqrt(4 s^2 - 4 (v1 + v) T s + 2 (v1^2 + v^2) T^2)

of which the one with 0 < x < T counts; after the turning point v = 2 s / T - v1. Where v_x would be
negative the actor stops and waits. A steady state takes its way and time off s and T. The phases
and their borders are esmini's, from its traces; the standard asks for the arrival only.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_cos, portable_sin
from twin.road.walk.distances import road_apart
from twin.road.walk.road_arrays import RoadArrays
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, PlayArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.ground import BodyPlace
from twin.scenario.storyboard.interpreter.transition import CLOSE, FAR, HALF, TWO, ZERO, sign_of
from twin.scenario.storyboard.player.columns import Real, Whole
from twin.scenario.storyboard.player.layout import real_column, whole_column
from twin.scenario.storyboard.program import actions as records
from twin.scenario.storyboard.program.actions import (
    NEARLY_STEADY,
    FinalSpeedKind,
    SteadyStateKind,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

_MASTER = whole_column(records.SynchronizeAction, "master")
_FINAL = whole_column(records.SynchronizeAction, "final_speed")
_FINAL_SPEED = real_column(records.SynchronizeAction, "final_speed_mps")
_STEADY = whole_column(records.SynchronizeAction, "steady_state")
_STEADY_VALUE = real_column(records.SynchronizeAction, "steady_state_value")
_SLACK = real_column(records.SynchronizeAction, "steady_slack")
_TOLERANCE = real_column(records.SynchronizeAction, "tolerance_m")
_MASTER_TOLERANCE = real_column(records.SynchronizeAction, "tolerance_master_m")
_WAY = whole_column(records.SynchronizeAction, "trajectory")
_WAY_S = real_column(records.SynchronizeAction, "trajectory_s_m")
_MASTER_WAY = whole_column(records.SynchronizeAction, "master_trajectory")
_MASTER_WAY_S = real_column(records.SynchronizeAction, "master_trajectory_s_m")
_NEAR_LINE = wp.constant(wp.float64(0.1))
"""The turning point is passed when the speed is that near to the last part's [m/s]."""
_BRAKE = wp.constant(wp.float64(-8.0))
"""Deceleration of a stop for which half the way is not enough [m/s^2]."""
_LITTLE = wp.constant(wp.float64(NEARLY_STEADY))

# Scratch: s, x, y of the actor's target, of the master's, and the distances at the last step.
TARGET = 0
MASTER_TARGET = 3
LAST = 6
MASTER_LAST = 7
OVER = 0
ROAD = 1
MASTER_ROAD = 2
PHASE = 3

_PHASE_NONE = wp.constant(wp.int32(0))
_PHASE_CONVEX = wp.constant(wp.int32(1))
_PHASE_CONCAVE = wp.constant(wp.int32(2))
_PHASE_LINE = wp.constant(wp.int32(3))
_PHASE_STOPPED = wp.constant(wp.int32(4))
_PHASE_BRAKE = wp.constant(wp.int32(5))
_PHASE_WAITING = wp.constant(wp.int32(6))
_PHASE_STEADY = wp.constant(wp.int32(7))
_PHASE_HELD = wp.constant(wp.int32(8))
"""Begun without time; the first step with time still stands."""


@wp.func
def start_synchronise(
    play: PlayArrays, slot: wp.int32, k: wp.int32, which: wp.int32, place: BodyPlace
):
    """Remember the target of the actor (``which`` 0) or of the master (1)."""
    first = wp.where(which == 0, TARGET, MASTER_TARGET)
    play.instance_reals[slot, k, first] = place.s
    play.instance_reals[slot, k, first + 1] = place.x
    play.instance_reals[slot, k, first + 2] = place.y
    play.instance_reals[slot, k, LAST + which] = FAR
    play.instance_wholes[slot, k, ROAD + which] = place.road
    play.instance_wholes[slot, k, OVER] = 0
    play.instance_wholes[slot, k, PHASE] = 0


@wp.func
def way_left(
    tables: ProgramArrays,
    before: BodyArrays,
    roads: RoadArrays,
    play: PlayArrays,
    slot: wp.int32,
    k: wp.int32,
    e: wp.int32,
    which: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
) -> wp.float64:
    """How far an entity is from its target: along its trajectory, else along roads, else straight.

    A target that is given on another trajectory counts by its distance from that one's beginning,
    as in esmini: NCAP CPRA gives one that lies beside the follower's.
    """
    way = tables.wholes[wholes + wp.where(which == 0, _WAY, _MASTER_WAY)]
    if way >= 0 and before.wholes[slot, e, Whole.TRAJECTORY] >= 0:
        target = tables.reals[reals + wp.where(which == 0, _WAY_S, _MASTER_WAY_S)]
        return wp.abs(target - before.reals[slot, e, Real.WAY])
    first = wp.where(which == 0, TARGET, MASTER_TARGET)
    road = play.instance_wholes[slot, k, ROAD + which]
    own_road = before.wholes[slot, e, Whole.ROAD]
    if road >= 0 and own_road >= 0:
        s, t = before.reals[slot, e, Real.S], before.reals[slot, e, Real.T]
        apart = road_apart(roads, own_road, s, t, road, play.instance_reals[slot, k, first], ZERO)
        if apart.reached != 0:
            return wp.abs(apart.ds)
    dx = play.instance_reals[slot, k, first + 1] - before.reals[slot, e, Real.X]
    dy = play.instance_reals[slot, k, first + 2] - before.reals[slot, e, Real.Y]
    return wp.sqrt(dx * dx + dy * dy)


@wp.func
def along_way(before: BodyArrays, slot: wp.int32, e: wp.int32) -> wp.float64:
    """Speed of an entity along its trajectory or its road, measured on its last step as in
    esmini."""
    vx, vy = before.reals[slot, e, Real.VX], before.reals[slot, e, Real.VY]
    sign = sign_of(before.reals[slot, e, Real.SPEED])
    if before.wholes[slot, e, Whole.TRAJECTORY] >= 0 or before.wholes[slot, e, Whole.ROAD] < 0:
        return sign * wp.sqrt(vx * vx + vy * vy)
    heading = before.reals[slot, e, Real.ROAD_HEADING]
    return sign * wp.abs(vx * portable_cos(heading) + vy * portable_sin(heading))


@wp.func
def step_synchronise(
    tables: ProgramArrays,
    before: BodyArrays,
    play: PlayArrays,
    slot: wp.int32,
    k: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
    speed: wp.float64,
    along: wp.float64,
    left: wp.float64,
    master_left: wp.float64,
    master_along: wp.float64,
    step_s: wp.float64,
) -> wp.float64:
    """The speed of this step, ``left`` and ``master_left`` being the ways that are left."""
    master = tables.wholes[wholes + _MASTER]
    tolerance = tables.reals[reals + _TOLERANCE]
    master_tolerance = tables.reals[reals + _MASTER_TOLERANCE]
    final_kind = tables.wholes[wholes + _FINAL]
    final = wp.float64(tables.reals[reals + _FINAL_SPEED])
    if final_kind == FinalSpeedKind.RELATIVE_TO_MASTER:
        final = final + before.reals[slot, master, Real.SPEED]
    done = left < tolerance + CLOSE or master_left < master_tolerance + CLOSE
    done = done or left > play.instance_reals[slot, k, LAST]
    done = done or master_left > play.instance_reals[slot, k, MASTER_LAST]
    play.instance_reals[slot, k, LAST] = left
    play.instance_reals[slot, k, MASTER_LAST] = master_left
    way = wp.max(left - tolerance, CLOSE)
    time = wp.float64(FAR)
    if wp.abs(master_along) > CLOSE:
        time = wp.max(master_left - master_tolerance, CLOSE) / wp.abs(master_along)
        done = done or time < step_s
    if done:
        play.instance_wholes[slot, k, OVER] = 1
        if final_kind == FinalSpeedKind.NONE:
            return speed
        return final
    if final_kind == FinalSpeedKind.NONE:
        return speed + TWO * (way / time - speed) / time * step_s
    steady = tables.wholes[wholes + _STEADY]
    if step_s == ZERO:
        # Nothing has moved yet: esmini takes the actor for one at rest.
        if steady != SteadyStateKind.NONE:
            play.instance_wholes[slot, k, PHASE] = _PHASE_HELD
        return ZERO
    phase = play.instance_wholes[slot, k, PHASE]
    if steady != SteadyStateKind.NONE and phase != _PHASE_STEADY:
        slack = tables.reals[reals + _SLACK]
        steady_way = tables.reals[reals + _STEADY_VALUE]
        if steady == SteadyStateKind.TIME:
            steady_way = steady_way * final
        steady_time = steady_way / wp.max(final, CLOSE)
        if way - steady_way < slack or time - steady_time < slack:
            phase = _PHASE_STEADY
            play.instance_wholes[slot, k, PHASE] = phase
        else:
            way -= steady_way
            time -= steady_time
    if phase == _PHASE_STEADY:
        return final
    return towards(play, slot, k, speed, along, final, way, time, step_s)


@wp.func
def towards(
    play: PlayArrays,
    slot: wp.int32,
    k: wp.int32,
    speed: wp.float64,
    along: wp.float64,
    final: wp.float64,
    way: wp.float64,
    time: wp.float64,
    step_s: wp.float64,
) -> wp.float64:
    """The speed of a step on the way to a final speed."""
    phase = play.instance_wholes[slot, k, PHASE]
    if phase == _PHASE_HELD:
        play.instance_wholes[slot, k, PHASE] = _PHASE_LINE
        return speed
    if phase == _PHASE_WAITING:
        if time >= FAR:
            return speed
        phase = _PHASE_NONE
    if phase == _PHASE_BRAKE:
        result = speed + _BRAKE * step_s
        if result < ZERO:
            result = ZERO
            phase = _PHASE_WAITING
        play.instance_wholes[slot, k, PHASE] = phase
        return result
    if phase == _PHASE_STOPPED:
        if time >= TWO * way / wp.max(final, CLOSE):
            return ZERO
        phase = _PHASE_LINE
    line = TWO * way / time - final
    if phase == _PHASE_LINE:
        play.instance_wholes[slot, k, PHASE] = phase
        if time >= FAR or way < _LITTLE or time < _LITTLE:
            return ZERO
        return wp.max(TWO * way / time - wp.max(final, ZERO), ZERO)
    turning = phase == _PHASE_CONVEX or phase == _PHASE_CONCAVE
    if turning and time < FAR and wp.abs(speed - line) < _NEAR_LINE:
        play.instance_wholes[slot, k, PHASE] = _PHASE_LINE
        return speed
    if phase == _PHASE_NONE:
        phase = wp.where(HALF * (final + speed) < way / time, _PHASE_CONVEX, _PHASE_CONCAVE)
    turn_speed = wp.float64(0.0)
    pull = wp.float64(0.0)
    change = final - along
    if wp.abs(change) < CLOSE:
        turn_speed = TWO * way / time - along
        pull = (turn_speed - along) / (HALF * time)
    else:
        squares = final * final + along * along
        inner = TWO * way * way - TWO * (final + along) * time * way + squares * time * time
        root = wp.sqrt(TWO) * wp.sqrt(wp.max(inner, ZERO))
        first = -(root + TWO * way - TWO * final * time) / (TWO * change)
        second = -(TWO * way - root - TWO * final * time) / (TWO * change)
        if first > ZERO and first < time:
            turn_speed = (TWO * way - root) / (TWO * time)
            pull = (turn_speed - along) / first
        elif second > ZERO and second < time:
            turn_speed = (TWO * way + root) / (TWO * time)
            pull = (turn_speed - along) / second
    if (phase == _PHASE_CONCAVE and pull > ZERO) or (phase == _PHASE_CONVEX and pull < ZERO):
        phase = _PHASE_LINE
        pull = ZERO
    elif turn_speed < ZERO:
        stop_time = TWO * along * way / (along * along + final * final)
        pull = wp.where(wp.abs(stop_time) > CLOSE, -along / wp.max(stop_time, CLOSE), ZERO)
        if stop_time * along > way:
            pull = _BRAKE
            phase = _PHASE_BRAKE
        if along + pull * step_s < ZERO:
            play.instance_wholes[slot, k, PHASE] = _PHASE_STOPPED
            return ZERO
    play.instance_wholes[slot, k, PHASE] = phase
    return speed + pull * step_s
