"""Warp functions: lane changes and lane offsets.

Both are transitions of the offset from the middle of a lane, over time or, for a lane change with a
distance, over the way along the road. A body that changes lanes covers its whole step, so that
with a lateral part r dt it goes on by sqrt((v dt)^2 - (r dt)^2), and heads along its way; it moves
sideways by no more than its step. An offset action turns the body by atan(r / v) and leaves
the way along the road to the default controller. Formulas are esmini's; the standard names none.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_atan2
from twin.road.walk.lanes import lane_centre
from twin.road.walk.road_arrays import RoadArrays
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, PlayArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.ground import BodyPlace, direction_of, lane_counted
from twin.scenario.storyboard.interpreter.speeds import AT, SPAN, START, TARGET
from twin.scenario.storyboard.interpreter.transition import (
    CLOSE,
    ONE,
    PI,
    ZERO,
    not_zero,
    sign_of,
    slope_at,
    span_by_bend,
    span_by_rate,
    value_at,
)
from twin.scenario.storyboard.player.columns import Real, Whole
from twin.scenario.storyboard.player.layout import real_column, whole_column
from twin.scenario.storyboard.program import actions as records
from twin.scenario.storyboard.program.actions import DynamicsDimension, DynamicsShape

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

_SHAPE = whole_column(records.LaneChangeAction, "dynamics.shape")
_DIMENSION = whole_column(records.LaneChangeAction, "dynamics.dimension")
_AMOUNT = real_column(records.LaneChangeAction, "dynamics.value")
_ENTITY = whole_column(records.LaneChangeAction, "entity")
_LANE = whole_column(records.LaneChangeAction, "lane")
_TARGET_OFFSET = real_column(records.LaneChangeAction, "target_offset_m")
_OFFSET_SHAPE = whole_column(records.LaneOffsetAction, "shape")
_OFFSET_BEND = real_column(records.LaneOffsetAction, "lateral_acceleration_max_mps2")
_OFFSET_ENTITY = whole_column(records.LaneOffsetAction, "entity")
_OFFSET_VALUE = real_column(records.LaneOffsetAction, "offset_m")
_OFFSET_CONTINUOUS = whole_column(records.LaneOffsetAction, "continuous")
_SQUARE = wp.constant(wp.float64(1.5707963267948966 - 1e-6))
"""Heading of a body that only moves sideways: short of square, so that it still has a direction."""

LANE = 1
"""Scratch: the lane in whose coordinates a lane change is."""
OVER = 0
"""Scratch: 1 when the action is over."""


@wp.struct
class LateralStep:
    """What a lateral action wants of a step."""

    offset: wp.float64
    turn: wp.float64
    ahead: wp.float64
    """Way along the road [m]; of lane changes only."""
    moves: wp.int32


@wp.func
def turned(turn: wp.float64, angle: wp.float64) -> wp.float64:
    """The turn of a body, which keeps its direction on the road, that heads an angle to the left
    as seen along s if positive."""
    if direction_of(turn) > 0:
        return angle
    return PI - angle


@wp.func
def over(
    offset: wp.float64, begin: wp.float64, target: wp.float64, at: wp.float64, span: wp.float64
):
    """1 if a transition has come to its end."""
    passed = sign_of(offset - target) != sign_of(begin - target) and at > ZERO
    if at > span - CLOSE or wp.abs(offset - target) < CLOSE or passed:
        return 1
    return 0


@wp.func
def start_lane_change(
    tables: ProgramArrays,
    before: BodyArrays,
    roads: RoadArrays,
    play: PlayArrays,
    slot: wp.int32,
    k: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
    place: BodyPlace,
):
    """Begin a lane change of a body at ``place``."""
    lane = tables.wholes[wholes + _LANE]
    entity = tables.wholes[wholes + _ENTITY]
    if entity >= 0:
        to_left = lane * direction_of(before.reals[slot, entity, Real.TURN])
        lane = lane_counted(before.wholes[slot, entity, Whole.LANE], to_left)
    middle = lane_centre(roads, place.road, lane, place.s)
    begin = place.t - middle[0]
    target = tables.reals[reals + _TARGET_OFFSET]
    span = tables.reals[reals + _AMOUNT]
    if tables.wholes[wholes + _DIMENSION] == DynamicsDimension.RATE:
        span = span_by_rate(tables.wholes[wholes + _SHAPE], target - begin, span)
    play.instance_reals[slot, k, START] = begin
    play.instance_reals[slot, k, TARGET] = target
    play.instance_reals[slot, k, AT] = ZERO
    play.instance_reals[slot, k, SPAN] = span
    play.instance_wholes[slot, k, LANE] = lane
    play.instance_wholes[slot, k, OVER] = 0


@wp.func
def step_lane_change(
    tables: ProgramArrays,
    play: PlayArrays,
    slot: wp.int32,
    k: wp.int32,
    wholes: wp.int32,
    speed: wp.float64,
    turn: wp.float64,
    step_s: wp.float64,
) -> LateralStep:
    """A step of a lane change, in the coordinates of its target lane; a body at rest waits."""
    wish = LateralStep()
    if wp.abs(speed) < CLOSE:
        return wish
    shape = tables.wholes[wholes + _SHAPE]
    begin = play.instance_reals[slot, k, START]
    target = play.instance_reals[slot, k, TARGET]
    span = play.instance_reals[slot, k, SPAN]
    at = wp.float64(play.instance_reals[slot, k, AT])
    rate = slope_at(shape, begin, target, at, span)
    step_m = wp.abs(speed) * step_s
    ahead = wp.float64(step_m)
    aside = wp.float64(0.0)
    angle = wp.float64(0.0)
    if tables.wholes[wholes + _DIMENSION] == DynamicsDimension.DISTANCE:
        ahead = step_m / wp.sqrt(ONE + rate * rate)
        at = wp.min(at + ahead, span)
        wish.offset = value_at(shape, begin, target, at, span)
        angle = portable_atan2(rate, ONE)
    else:
        aside = step_s * wp.abs(rate)
        cut = wp.min(aside, step_m)
        ahead = wp.sqrt(step_m * step_m - cut * cut)
        if aside < step_m + CLOSE:
            at = wp.min(at + step_s, span)
            wish.offset = value_at(shape, begin, target, at, span)
            angle = portable_atan2(sign_of(speed) * sign_of(rate) * aside, ahead)
        else:
            at = wp.min(at + step_m * span / not_zero(wp.abs(target - begin)), span)
            flat = wp.where(shape == DynamicsShape.STEP, shape, wp.int32(DynamicsShape.LINEAR))
            wish.offset = value_at(flat, begin, target, at, span)
            angle = sign_of(speed) * sign_of(rate) * _SQUARE
    if shape == DynamicsShape.STEP or span < CLOSE:
        ahead = step_m
    wish.ahead = sign_of(speed) * ahead
    wish.moves = 1
    play.instance_reals[slot, k, AT] = at
    play.instance_wholes[slot, k, OVER] = over(wish.offset, begin, target, at, span)
    if play.instance_wholes[slot, k, OVER] != 0:
        angle = ZERO
    wish.turn = turned(turn, angle)
    return wish


@wp.func
def offset_wanted(
    tables: ProgramArrays,
    before: BodyArrays,
    slot: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
    place: BodyPlace,
) -> wp.float64:
    """Where an offset action leads, from the middle of the own lane."""
    value = tables.reals[reals + _OFFSET_VALUE]
    entity = tables.wholes[wholes + _OFFSET_ENTITY]
    if entity < 0:
        return value
    sign = wp.float64(direction_of(before.reals[slot, entity, Real.TURN]))
    return before.reals[slot, entity, Real.T] + sign * value - (place.t - place.offset)


@wp.func
def start_offset(
    tables: ProgramArrays,
    before: BodyArrays,
    play: PlayArrays,
    slot: wp.int32,
    k: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
    place: BodyPlace,
):
    """Begin a lane offset of a body at ``place``."""
    target = offset_wanted(tables, before, slot, reals, wholes, place)
    bend = tables.reals[reals + _OFFSET_BEND]
    play.instance_reals[slot, k, START] = place.offset
    play.instance_reals[slot, k, TARGET] = target
    play.instance_reals[slot, k, AT] = ZERO
    play.instance_reals[slot, k, SPAN] = span_by_bend(
        tables.wholes[wholes + _OFFSET_SHAPE], target - place.offset, bend
    )
    play.instance_wholes[slot, k, OVER] = 0


@wp.func
def step_offset(
    tables: ProgramArrays,
    before: BodyArrays,
    play: PlayArrays,
    slot: wp.int32,
    k: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
    place: BodyPlace,
    speed: wp.float64,
    step_s: wp.float64,
) -> LateralStep:
    """A step of a lane offset. The offset is that of the beginning of the step, as in esmini; a
    continuous action stays at its target, which may move."""
    wish = LateralStep()
    shape = tables.wholes[wholes + _OFFSET_SHAPE]
    begin = play.instance_reals[slot, k, START]
    target = play.instance_reals[slot, k, TARGET]
    span = play.instance_reals[slot, k, SPAN]
    at = play.instance_reals[slot, k, AT]
    wish.moves = 1
    wish.offset = value_at(shape, begin, target, at, span)
    if over(wish.offset, begin, target, at, span) != 0:
        wish.offset = target
        wish.turn = turned(place.turn, ZERO)
        if tables.wholes[wholes + _OFFSET_CONTINUOUS] != 0:
            wish.offset = offset_wanted(tables, before, slot, reals, wholes, place)
        else:
            play.instance_wholes[slot, k, OVER] = 1
        return wish
    rate = slope_at(shape, begin, target, at, span)
    wish.turn = turned(place.turn, portable_atan2(rate / not_zero(speed), ONE))
    play.instance_reals[slot, k, AT] = wp.min(at + step_s, span)
    return wish
