"""Warp functions: speed actions (ASAM OpenSCENARIO XML 1.3, SpeedAction, SpeedProfileAction).

A speed is a transition over time. Where its dimension is a distance the time follows from constant
acceleration, t = 2 d / (v0 + v1), or in two parts about standstill where the sign changes. The
actor's own limits stretch the transition so that its peak slope is the largest acceleration; after
the transition, and in each step, the speed follows the target as fast as they allow. All as in
esmini, where the standard names no formula.
"""

from __future__ import annotations

import warp as wp

from twin.scenario.storyboard.interpreter.arrays import BodyArrays, PlayArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.transition import (
    CLOSE,
    FAR,
    FOUR,
    HALF,
    ONE,
    TWO,
    ZERO,
    sign_of,
    slope_peak,
    span_by_rate,
    value_at,
)
from twin.scenario.storyboard.player.columns import EntityColumn, Real
from twin.scenario.storyboard.player.layout import layout_of, real_column, whole_column
from twin.scenario.storyboard.program import actions as records
from twin.scenario.storyboard.program.actions import DynamicsDimension, DynamicsShape

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

_SHAPE = whole_column(records.SpeedAction, "dynamics.shape")
_DIMENSION = whole_column(records.SpeedAction, "dynamics.dimension")
_AMOUNT = real_column(records.SpeedAction, "dynamics.value")
_ENTITY = whole_column(records.SpeedAction, "entity")
_VALUE = real_column(records.SpeedAction, "value")
_FACTOR = whole_column(records.SpeedAction, "factor")
_CONTINUOUS = whole_column(records.SpeedAction, "continuous")
_PROFILE_ENTITY = whole_column(records.SpeedProfileAction, "entity")
_PROFILE_FOLLOW = whole_column(records.SpeedProfileAction, "follow")
_PROFILE_COUNT = whole_column(records.SpeedProfileAction, "entries.tail")
_PROFILE_UP = real_column(records.SpeedProfileAction, "limits.acceleration_max_mps2")
_PROFILE_DOWN = real_column(records.SpeedProfileAction, "limits.deceleration_max_mps2")
_PROFILE_RATE_UP = real_column(records.SpeedProfileAction, "limits.acceleration_rate_max_mps3")
_PROFILE_RATE_DOWN = real_column(records.SpeedProfileAction, "limits.deceleration_rate_max_mps3")
_PROFILE_FIRST = len(layout_of(records.SpeedProfileAction).reals)

# Scratch of running transitions.
START = 0
TARGET = 1
AT = 2
SPAN = 3
SCALE = 4
REACHED = 0


@wp.func
def within(value: wp.float64, limit: wp.float64) -> wp.float64:
    """The value, cut at plus and minus a limit."""
    return wp.max(wp.min(value, limit), -limit)


@wp.func
def speed_wanted(
    tables: ProgramArrays, before: BodyArrays, slot: wp.int32, reals: wp.int32, wholes: wp.int32
) -> wp.float64:
    """The target speed of a speed action."""
    value = tables.reals[reals + _VALUE]
    entity = tables.wholes[wholes + _ENTITY]
    if entity < 0:
        return value
    speed = before.reals[slot, entity, Real.SPEED]
    if tables.wholes[wholes + _FACTOR] != 0:
        return speed * value
    return speed + value


@wp.func
def span_by_distance(speed: wp.float64, target: wp.float64, distance: wp.float64) -> wp.float64:
    """Time in which the speed changes over a distance."""
    if wp.abs(target - speed) < CLOSE:
        return ZERO
    turns = wp.abs(speed) > CLOSE and wp.abs(target) > CLOSE and speed * target < ZERO
    if turns:
        share = speed * speed / (speed * speed + target * target)
        first = share * distance
        return TWO * first / wp.abs(speed) + TWO * (distance - first) / wp.abs(target)
    return TWO * distance / wp.abs(speed + target)


@wp.func
def start_speed(
    tables: ProgramArrays,
    before: BodyArrays,
    play: PlayArrays,
    slot: wp.int32,
    k: wp.int32,
    row: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
    speed: wp.float64,
) -> wp.float64:
    """Begin a speed action; the speed at once."""
    shape = tables.wholes[wholes + _SHAPE]
    dimension = tables.wholes[wholes + _DIMENSION]
    amount = tables.reals[reals + _AMOUNT]
    wanted = speed_wanted(tables, before, slot, reals, wholes)
    target = within(wanted, tables.entity_reals[row, EntityColumn.SPEED_MAX])
    span = wp.float64(amount)
    if dimension == DynamicsDimension.DISTANCE:
        span = span_by_distance(speed, wanted, amount)
    elif dimension == DynamicsDimension.RATE:
        span = span_by_rate(shape, target - speed, amount)
    peak = FAR
    if dimension == DynamicsDimension.RATE:
        peak = wp.abs(amount)
    elif shape != DynamicsShape.STEP and span >= CLOSE:
        peak = slope_peak(shape) * wp.abs(target - speed) / span
    limit = tables.entity_reals[row, EntityColumn.DECELERATION_MAX]
    if target > speed:
        limit = tables.entity_reals[row, EntityColumn.ACCELERATION_MAX]
    play.instance_reals[slot, k, START] = speed
    play.instance_reals[slot, k, TARGET] = target
    play.instance_reals[slot, k, AT] = ZERO
    play.instance_reals[slot, k, SPAN] = span
    play.instance_reals[slot, k, SCALE] = wp.max(peak / wp.max(limit, CLOSE), ONE)
    play.instance_wholes[slot, k, REACHED] = 0
    return value_at(shape, speed, target, ZERO, span)


@wp.func
def step_speed(
    tables: ProgramArrays,
    before: BodyArrays,
    play: PlayArrays,
    slot: wp.int32,
    k: wp.int32,
    row: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
    speed: wp.float64,
    step_s: wp.float64,
) -> wp.float64:
    """The speed at the end of a step; ``REACHED`` of the scratch is 1 when the action is over."""
    shape = tables.wholes[wholes + _SHAPE]
    relative = tables.wholes[wholes + _ENTITY] >= 0
    speed_max = tables.entity_reals[row, EntityColumn.SPEED_MAX]
    up = tables.entity_reals[row, EntityColumn.ACCELERATION_MAX]
    down = tables.entity_reals[row, EntityColumn.DECELERATION_MAX]
    begin = play.instance_reals[slot, k, START]
    span = play.instance_reals[slot, k, SPAN]
    at = wp.float64(play.instance_reals[slot, k, AT])
    scale = play.instance_reals[slot, k, SCALE]
    wanted = within(speed_wanted(tables, before, slot, reals, wholes), speed_max)
    target = wp.float64(play.instance_reals[slot, k, TARGET])
    if relative:
        target = wanted
        if tables.wholes[wholes + _DIMENSION] == DynamicsDimension.RATE:
            span = span_by_rate(shape, target - begin, tables.reals[reals + _AMOUNT])
    result = speed
    if span > ZERO and at > span - CLOSE:
        if step_s > CLOSE:
            result = speed + wp.clamp((wanted - speed) / step_s, -down, up) * step_s
    else:
        at = wp.clamp(at + step_s / scale, ZERO, span)
        result = value_at(shape, begin, target, at, span)
        if step_s > CLOSE:
            needed = (result - speed) / step_s
            if needed > up + CLOSE or needed < -down - CLOSE:
                result = within(speed + wp.clamp(needed, -down, up) * step_s, speed_max)
                at = wp.clamp(at - (step_s - (result - speed) / needed) / scale, ZERO, span)
    if at > span - CLOSE and wp.abs(result - target) < CLOSE:
        result = wanted
        if not (relative and tables.wholes[wholes + _CONTINUOUS] != 0):
            play.instance_wholes[slot, k, REACHED] = 1
    play.instance_reals[slot, k, TARGET] = target
    play.instance_reals[slot, k, SPAN] = span
    play.instance_reals[slot, k, AT] = at
    return sign_of(result) * wp.abs(result)


@wp.func
def start_profile(
    tables: ProgramArrays,
    before: BodyArrays,
    play: PlayArrays,
    slot: wp.int32,
    k: wp.int32,
    wholes: wp.int32,
    speed: wp.float64,
):
    """Begin a speed profile."""
    base = ZERO
    entity = tables.wholes[wholes + _PROFILE_ENTITY]
    if entity >= 0:
        base = before.reals[slot, entity, Real.SPEED]
    play.instance_reals[slot, k, START] = speed
    play.instance_reals[slot, k, TARGET] = base
    play.instance_reals[slot, k, AT] = ZERO
    play.instance_wholes[slot, k, REACHED] = 0


@wp.func
def shortest_ease(change: wp.float64, limit: wp.float64, rate: wp.float64) -> wp.float64:
    """Shortest time of :func:`eased` for a change of speed with a largest acceleration: with one
    that is reached d / A + A / J, else 2 sqrt(d / J)."""
    most = wp.max(limit, CLOSE)
    if most * most < change * rate:
        return change / most + most / rate
    return TWO * wp.sqrt(change / rate)


@wp.func
def eased(
    speed: wp.float64, target: wp.float64, at: wp.float64, duration: wp.float64, rate: wp.float64
) -> wp.float64:
    """A change of speed that begins and ends without acceleration, which changes by a rate.

    Over the time T the acceleration rises for a / J, stays at a, and falls for a / J. With the
    change d = a (T - a / J), a = 2 d / (T + sqrt(T^2 - 4 d / J)).
    """
    change = wp.abs(target - speed)
    root = wp.sqrt(wp.max(duration * duration - FOUR * change / rate, ZERO))
    most = TWO * change / (duration + root)
    rise = most / rate
    left = duration - at
    gone = most * (at - HALF * rise)
    if at < rise:
        gone = HALF * rate * at * at
    elif left < rise:
        gone = change - HALF * rate * left * left
    return speed + wp.where(target > speed, gone, -gone)


@wp.func
def step_profile(
    tables: ProgramArrays,
    play: PlayArrays,
    slot: wp.int32,
    k: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
    step_s: wp.float64,
) -> wp.float64:
    """The speed at the end of a step: from entry to entry, see :func:`eased`.

    An entry without a time is reached as fast as the limits of the action allow, and one that would
    need more is reached later if the action keeps to its limits (following mode ``follow``).
    """
    follows = tables.wholes[wholes + _PROFILE_FOLLOW]
    at = play.instance_reals[slot, k, AT] + step_s
    play.instance_reals[slot, k, AT] = at
    base = play.instance_reals[slot, k, TARGET]
    speed = wp.float64(play.instance_reals[slot, k, START])
    begin = wp.float64(0.0)
    for entry in range(tables.wholes[wholes + _PROFILE_COUNT]):
        first = reals + _PROFILE_FIRST + 2 * entry
        target = tables.reals[first] + base
        duration = wp.float64(tables.reals[first + 1])
        limit = wp.float64(tables.reals[reals + _PROFILE_DOWN])
        rate = wp.float64(tables.reals[reals + _PROFILE_RATE_DOWN])
        if target > speed:
            limit = tables.reals[reals + _PROFILE_UP]
            rate = tables.reals[reals + _PROFILE_RATE_UP]
        if duration >= ZERO and follows == 0:
            rate = FAR
        shortest = wp.abs(target - speed) / wp.max(limit, CLOSE)
        if rate < FAR:
            rate = wp.max(rate, CLOSE)
            shortest = shortest_ease(wp.abs(target - speed), limit, rate)
        if duration < ZERO:
            duration = shortest
        elif follows != 0:
            duration = wp.max(duration, shortest)
        if at < begin + duration - CLOSE:
            if rate < FAR:
                return eased(speed, target, at - begin, duration, rate)
            return speed + (target - speed) * (at - begin) / duration
        begin += duration
        speed = target
    play.instance_wholes[slot, k, REACHED] = 1
    return speed
