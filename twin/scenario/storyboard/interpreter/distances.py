"""Warp functions: keeping a distance to another entity, ahead or beside.

Without limits an actor is put at its distance and takes over the other's speed. With limits it
follows a critically damped spring, a = k (gap - wanted) + 2 sqrt(k) (v_other - v), with k = 0.4/m
times the largest deceleration (acceleration where it is too near). That is esmini's controller,
checked with its traces; the standard names none. A time gap counts with the speed of the other
entity, as in esmini.
"""

from __future__ import annotations

import warp as wp

from twin.road.walk.road_arrays import RoadArrays
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, PlayArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.ground import place_of
from twin.scenario.storyboard.interpreter.measures import distance_to
from twin.scenario.storyboard.interpreter.transition import FAR, TWO, ZERO
from twin.scenario.storyboard.player.columns import Real
from twin.scenario.storyboard.player.layout import real_column, whole_column
from twin.scenario.storyboard.program import actions as records
from twin.scenario.storyboard.program.actions import Displacement
from twin.scenario.storyboard.program.conditions import DistanceKind

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

_ENTITY = whole_column(records.LongitudinalDistanceAction, "entity")
_VALUE = real_column(records.LongitudinalDistanceAction, "value")
_TIME_GAP = whole_column(records.LongitudinalDistanceAction, "time_gap")
_FREE = whole_column(records.LongitudinalDistanceAction, "freespace")
_CONTINUOUS = whole_column(records.LongitudinalDistanceAction, "continuous")
_FRAME = whole_column(records.LongitudinalDistanceAction, "frame")
_SIDE = whole_column(records.LongitudinalDistanceAction, "displacement")
_UP = real_column(records.LongitudinalDistanceAction, "limits.acceleration_max_mps2")
_DOWN = real_column(records.LongitudinalDistanceAction, "limits.deceleration_max_mps2")
_SPEED = real_column(records.LongitudinalDistanceAction, "limits.speed_max_mps")
_RATE_UP = real_column(records.LongitudinalDistanceAction, "limits.acceleration_rate_max_mps3")
_RATE_DOWN = real_column(records.LongitudinalDistanceAction, "limits.deceleration_rate_max_mps3")
_ASIDE_ENTITY = whole_column(records.LateralDistanceAction, "entity")
_ASIDE_VALUE = real_column(records.LateralDistanceAction, "distance_m")
_ASIDE_FREE = whole_column(records.LateralDistanceAction, "freespace")
_ASIDE_CONTINUOUS = whole_column(records.LateralDistanceAction, "continuous")
_ASIDE_FRAME = whole_column(records.LateralDistanceAction, "frame")
_ASIDE_SIDE = whole_column(records.LateralDistanceAction, "displacement")
_ASIDE_UP = real_column(records.LateralDistanceAction, "limits.acceleration_max_mps2")
_ASIDE_DOWN = real_column(records.LateralDistanceAction, "limits.deceleration_max_mps2")
_ASIDE_SPEED = real_column(records.LateralDistanceAction, "limits.speed_max_mps")
_SPRING = wp.constant(wp.float64(0.4))
_REACHED_M = wp.constant(wp.float64(0.1))
"""A distance that is kept only once is reached within this [m]."""
_ASIDE_REACHED_M = wp.constant(wp.float64(0.01))

PULL = 0
"""Scratch: acceleration of the last step, or lateral speed."""
OVER = 0
"""Scratch: 1 when the action is over."""
SIDE = 1
"""Scratch: 1 of an actor ahead of, or to the left of, the other, -1 else."""


@wp.struct
class GapStep:
    """What keeping a distance wants of a step."""

    speed: wp.float64
    ahead: wp.float64
    """Jump forwards or, of a lateral distance, way to the left as the actor sees it [m]."""


@wp.func
def gap_now(
    tables: ProgramArrays,
    before: BodyArrays,
    roads: RoadArrays,
    slot: wp.int32,
    base: wp.int32,
    e: wp.int32,
    wholes: wp.int32,
    aside: wp.bool,
) -> wp.float64:
    """Distance from an actor to the other, ahead or to the left positive."""
    entity = wp.where(aside, _ASIDE_ENTITY, _ENTITY)
    other = tables.wholes[wholes + entity]
    frame = tables.wholes[wholes + wp.where(aside, _ASIDE_FRAME, _FRAME)]
    free = tables.wholes[wholes + wp.where(aside, _ASIDE_FREE, _FREE)]
    kind = wp.where(aside, wp.int32(DistanceKind.LATERAL), wp.int32(DistanceKind.LONGITUDINAL))
    place = place_of(before, slot, other)
    return distance_to(
        tables, before, roads, slot, base + e, e, place, base + other, other, frame, kind, free
    )


@wp.func
def start_gap(
    tables: ProgramArrays,
    play: PlayArrays,
    slot: wp.int32,
    k: wp.int32,
    wholes: wp.int32,
    aside: wp.bool,
    gap: wp.float64,
):
    """Begin to keep a distance; the side that is not given is the one the actor is on."""
    side = tables.wholes[wholes + wp.where(aside, _ASIDE_SIDE, _SIDE)]
    sign = wp.where(gap < ZERO, 1, -1)
    if side == Displacement.AHEAD:
        sign = 1
    elif side == Displacement.BEHIND:
        sign = -1
    play.instance_reals[slot, k, PULL] = ZERO
    play.instance_wholes[slot, k, OVER] = 0
    play.instance_wholes[slot, k, SIDE] = sign


@wp.func
def step_gap(
    tables: ProgramArrays,
    before: BodyArrays,
    play: PlayArrays,
    slot: wp.int32,
    k: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
    speed: wp.float64,
    gap: wp.float64,
    step_s: wp.float64,
) -> GapStep:
    """A step of keeping a longitudinal distance, ``gap`` being what it is now."""
    wish = GapStep()
    other = tables.wholes[wholes + _ENTITY]
    other_speed = before.reals[slot, other, Real.SPEED]
    wanted = wp.abs(tables.reals[reals + _VALUE])
    if tables.wholes[wholes + _TIME_GAP] != 0:
        wanted = wanted * wp.abs(other_speed)
    missing = gap + wanted * wp.float64(play.instance_wholes[slot, k, SIDE])
    if tables.wholes[wholes + _CONTINUOUS] == 0 and wp.abs(missing) < _REACHED_M:
        play.instance_wholes[slot, k, OVER] = 1
    up, down = tables.reals[reals + _UP], tables.reals[reals + _DOWN]
    if wp.min(up, down) >= FAR:
        wish.ahead = missing
        wish.speed = other_speed
        return wish
    last = play.instance_reals[slot, k, PULL]
    spring = _SPRING * wp.where(missing < ZERO, up, down)
    pull = missing * spring - (speed - other_speed) * TWO * wp.sqrt(spring)
    pull = wp.clamp(pull, -down, up)
    if pull < ZERO and pull < last:
        pull = wp.max(last - rate_times(tables.reals[reals + _RATE_DOWN], step_s), pull)
    elif pull > ZERO and pull > last:
        pull = wp.min(last + rate_times(tables.reals[reals + _RATE_UP], step_s), pull)
    play.instance_reals[slot, k, PULL] = pull
    speed_max = tables.reals[reals + _SPEED]
    wish.speed = wp.clamp(speed + pull * step_s, ZERO, speed_max)
    return wish


@wp.func
def rate_times(rate: wp.float64, time_s: wp.float64) -> wp.float64:
    """What a rate gives in a time; one without limit gives any amount."""
    if rate >= FAR:
        return FAR
    return rate * time_s


@wp.func
def step_aside(
    tables: ProgramArrays,
    play: PlayArrays,
    slot: wp.int32,
    k: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
    gap: wp.float64,
    step_s: wp.float64,
) -> GapStep:
    """A step of keeping a lateral distance, as fast as the limits allow: the lateral speed from
    which the largest deceleration still stops at the target, v^2 = 2 a d."""
    wish = GapStep()
    wanted = wp.abs(tables.reals[reals + _ASIDE_VALUE])
    missing = gap + wanted * wp.float64(play.instance_wholes[slot, k, SIDE])
    if tables.wholes[wholes + _ASIDE_CONTINUOUS] == 0 and wp.abs(missing) < _ASIDE_REACHED_M:
        play.instance_wholes[slot, k, OVER] = 1
    up, down = tables.reals[reals + _ASIDE_UP], tables.reals[reals + _ASIDE_DOWN]
    most = tables.reals[reals + _ASIDE_SPEED] * step_s
    way = wp.abs(missing)
    if down < FAR:
        way = wp.min(way, wp.sqrt(TWO * down * way) * step_s)
    if up < FAR:
        way = wp.min(way, wp.max(play.instance_reals[slot, k, PULL] + up * step_s, ZERO) * step_s)
    if most < FAR:
        way = wp.min(way, most)
    if step_s > ZERO:
        play.instance_reals[slot, k, PULL] = way / step_s
    wish.ahead = wp.where(missing < ZERO, -way, way)
    return wish
