"""The kernel of driver models: following by IDM, changing lanes by MOBIL.

IDM (Treiber, Hennecke, Helbing 2000, Phys. Rev. E 62, 1805), with v own speed, dv closing speed and
s the gap between boxes along the road::

    a_idm = a (1 - (v / v0)^exponent - (s_wanted / s)^2)
    s_wanted = s0 + max(0, v T + v dv / (2 sqrt(a b)))

MOBIL (Kesting, Treiber, Helbing 2007, Transp. Res. Rec. 1999, 86): a lane may be taken if the
driver behind there need not brake harder than is safe, and if ::

    own gain + politeness (gain of the new driver behind + gain of the old one) > threshold

Of the two lanes the one with the greater gain is taken, the left one if they are equal. Drivers
behind without a model count with the parameters of the one who decides. A change is a cubic
transition of the offset over ``change_duration_s``, while which no other is begun.

All others are seen as they were at the beginning of the phase, so no order of drivers matters.
Who counts as in a lane has the origin within half of its width of its middle.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_atan2, portable_cos, portable_sin
from twin.road.walk.distances import road_apart
from twin.road.walk.lanes import (
    lane_beside,
    lane_centre,
    lane_driven,
    lane_sign,
    lane_width,
)
from twin.road.walk.road_arrays import RoadArrays
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, PlayArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.ground import direction_of
from twin.scenario.storyboard.interpreter.laterals import turned
from twin.scenario.storyboard.interpreter.transition import (
    CLOSE,
    FAR,
    HALF,
    ONE,
    TWO,
    ZERO,
    not_zero,
    slope_at,
    value_at,
)
from twin.scenario.storyboard.player.columns import (
    Domain,
    EntityColumn,
    ProgramColumn,
    Real,
    SlotColumn,
    Whole,
)
from twin.scenario.storyboard.program.actions import DynamicsShape

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

MODEL_FIELDS = (
    *("desired_speed", "time_gap", "gap_min", "acceleration", "deceleration", "exponent"),
    *("politeness", "threshold", "deceleration_safe", "change_duration"),
)
"""Columns of ``models``."""
_DESIRED = MODEL_FIELDS.index("desired_speed")
_TIME_GAP = MODEL_FIELDS.index("time_gap")
_GAP_MIN = MODEL_FIELDS.index("gap_min")
_UP = MODEL_FIELDS.index("acceleration")
_DOWN = MODEL_FIELDS.index("deceleration")
_EXPONENT = MODEL_FIELDS.index("exponent")
_POLITENESS = MODEL_FIELDS.index("politeness")
_THRESHOLD = MODEL_FIELDS.index("threshold")
_SAFE = MODEL_FIELDS.index("deceleration_safe")
_DURATION = MODEL_FIELDS.index("change_duration")
_GAP_LEAST = wp.constant(wp.float64(0.1))
"""Gaps count as at least that long [m]."""
_OPEN_LANE_M = wp.constant(wp.float64(3.5))
"""Width of the own lane where there is no road [m]."""


@wp.struct
class LaneNeighbours:
    """Who is next ahead and behind in the own lane, the left and the right one."""

    gap_ahead: wp.vec3d
    speed_ahead: wp.vec3d
    gap_behind: wp.vec3d
    speed_behind: wp.vec3d
    behind: wp.vec3i
    """Entities; -1: none."""


@wp.struct
class SeenBody:
    """Another body, as seen along the way of the first."""

    there: wp.int32
    ahead: wp.float64
    """From origin to origin [m]."""
    left: wp.float64
    speed: wp.float64
    """Along the first one's way [m/s]."""
    same: wp.int32
    """1: it heads the same way."""


@wp.func
def see_body(
    roads: RoadArrays, before: BodyArrays, slot: wp.int32, e: wp.int32, other: wp.int32
) -> SeenBody:
    """``other`` as seen by ``e``: along the road, or along its heading where there is none."""
    seen = SeenBody()
    if before.wholes[slot, other, Whole.PRESENT] == 0:
        return seen
    speed = before.reals[slot, other, Real.SPEED]
    road = before.wholes[slot, e, Whole.ROAD]
    far_road = before.wholes[slot, other, Whole.ROAD]
    if road >= 0 and far_road >= 0:
        apart = road_apart(
            roads,
            road,
            before.reals[slot, e, Real.S],
            before.reals[slot, e, Real.T],
            far_road,
            before.reals[slot, other, Real.S],
            before.reals[slot, other, Real.T],
        )
        if apart.reached == 0:
            return seen
        way = direction_of(before.reals[slot, e, Real.TURN])
        far_way = direction_of(before.reals[slot, other, Real.TURN]) * apart.sign
        seen.ahead = apart.ds * wp.float64(way)
        seen.left = apart.dt * wp.float64(way)
        seen.same = wp.where(way == far_way, 1, 0)
    else:
        heading = before.reals[slot, e, Real.HEADING]
        cosine, sine = portable_cos(heading), portable_sin(heading)
        dx = before.reals[slot, other, Real.X] - before.reals[slot, e, Real.X]
        dy = before.reals[slot, other, Real.Y] - before.reals[slot, e, Real.Y]
        seen.ahead = dx * cosine + dy * sine
        seen.left = dy * cosine - dx * sine
        along = portable_cos(before.reals[slot, other, Real.HEADING] - heading)
        seen.same = wp.where(along >= ZERO, 1, 0)
    seen.there = 1
    seen.speed = wp.where(seen.same != 0, speed, -speed)
    return seen


@wp.func
def neighbours_of(
    tables: ProgramArrays,
    roads: RoadArrays,
    before: BodyArrays,
    slot: wp.int32,
    base: wp.int32,
    count: wp.int32,
    e: wp.int32,
    middles: wp.vec3d,
    half_width: wp.float64,
) -> LaneNeighbours:
    """The neighbours of a body in three lanes whose middles are so far to its left."""
    near = LaneNeighbours()
    near.gap_ahead = wp.vec3d(FAR, FAR, FAR)
    near.gap_behind = wp.vec3d(FAR, FAR, FAR)
    near.behind = wp.vec3i(-1, -1, -1)
    half = HALF * tables.entity_reals[base + e, EntityColumn.LENGTH]
    front = half + tables.entity_reals[base + e, EntityColumn.CENTRE_X]
    rear = half - tables.entity_reals[base + e, EntityColumn.CENTRE_X]
    for other in range(count):
        if other != e:
            seen = see_body(roads, before, slot, e, other)
            if seen.there != 0:
                far_half = HALF * tables.entity_reals[base + other, EntityColumn.LENGTH]
                centre = tables.entity_reals[base + other, EntityColumn.CENTRE_X]
                far_front = wp.where(seen.same != 0, far_half + centre, far_half - centre)
                far_rear = wp.where(seen.same != 0, far_half - centre, far_half + centre)
                for lane in range(3):
                    if wp.abs(seen.left - middles[lane]) < half_width:
                        if seen.ahead >= ZERO:
                            gap = seen.ahead - front - far_rear
                            if gap < near.gap_ahead[lane]:
                                near.gap_ahead[lane] = gap
                                near.speed_ahead[lane] = seen.speed
                        else:
                            gap = -seen.ahead - rear - far_front
                            if gap < near.gap_behind[lane]:
                                near.gap_behind[lane] = gap
                                near.speed_behind[lane] = seen.speed
                                near.behind[lane] = other
    return near


@wp.func
def follow_pull(
    tables: ProgramArrays,
    model: wp.int32,
    speed: wp.float64,
    gap: wp.float64,
    ahead_speed: wp.float64,
) -> wp.float64:
    """Acceleration of IDM; ``gap`` at least ``FAR``: nobody is ahead."""
    up, down = tables.models[model, _UP], tables.models[model, _DOWN]
    share = speed / wp.max(tables.models[model, _DESIRED], CLOSE)
    power = wp.float64(1.0)
    for _ in range(wp.int32(tables.models[model, _EXPONENT])):
        power *= share
    if gap >= FAR:
        return up * (ONE - power)
    closing = speed * (speed - ahead_speed) / (TWO * wp.sqrt(up * down))
    wanted = tables.models[model, _GAP_MIN] + wp.max(
        speed * tables.models[model, _TIME_GAP] + closing, ZERO
    )
    ratio = wanted / wp.max(gap, _GAP_LEAST)
    return up * (ONE - power - ratio * ratio)


@wp.func
def lane_gain(
    tables: ProgramArrays,
    before: BodyArrays,
    slot: wp.int32,
    model: wp.int32,
    speed: wp.float64,
    length: wp.float64,
    near: LaneNeighbours,
    lane: wp.int32,
) -> wp.float64:
    """How much more than the threshold a change gains; negative if it is not to be."""
    own = follow_pull(tables, model, speed, near.gap_ahead[lane], near.speed_ahead[lane])
    gain = own - follow_pull(tables, model, speed, near.gap_ahead[0], near.speed_ahead[0])
    if wp.min(near.gap_ahead[lane], near.gap_behind[lane]) < _GAP_LEAST:
        return -ONE
    others = wp.float64(0.0)
    if near.behind[lane] >= 0:
        rule = before.wholes[slot, near.behind[lane], Whole.MODEL]
        if rule < 0:
            rule = model
        behind = near.speed_behind[lane]
        free = near.gap_behind[lane] + length + near.gap_ahead[lane]
        after = follow_pull(tables, rule, behind, near.gap_behind[lane], speed)
        if after < -tables.models[model, _SAFE]:
            return -ONE
        others += after - follow_pull(tables, rule, behind, free, near.speed_ahead[lane])
    if near.behind[0] >= 0:
        rule = before.wholes[slot, near.behind[0], Whole.MODEL]
        if rule < 0:
            rule = model
        behind = near.speed_behind[0]
        free = near.gap_behind[0] + length + near.gap_ahead[0]
        after = follow_pull(tables, rule, behind, free, near.speed_ahead[0])
        others += after - follow_pull(tables, rule, behind, near.gap_behind[0], speed)
    return gain + tables.models[model, _POLITENESS] * others - tables.models[model, _THRESHOLD]


@wp.func
def lane_open(
    roads: RoadArrays, road: wp.int32, s: wp.float64, lane: wp.int32, to_left: wp.int32
) -> wp.int32:
    """The lane beside, 0 if cars do not drive there in the same direction."""
    target = lane_beside(roads, road, s, lane, to_left)
    if target == 0:
        return 0
    if not lane_driven(roads, road, target, s):
        return 0
    if lane_sign(roads, road, target, s) != lane_sign(roads, road, lane, s):
        return 0
    return target


@wp.kernel
def drivers_kernel(
    # model
    tables: ProgramArrays,
    roads: RoadArrays,
    # args
    only: wp.int32,
    step_s: wp.float64,
    # state in
    before: BodyArrays,
    play: PlayArrays,
    # state in and out
    now: BodyArrays,
):
    """Speeds and lanes of bodies with a driver model; the default controller then moves them."""
    slot, e = wp.tid()
    if (only >= 0 and slot != only) or play.slots[slot, SlotColumn.RUNNING] == 0:
        return
    program = play.slots[slot, SlotColumn.PROGRAM]
    count = tables.programs[program, ProgramColumn.ENTITIES]
    if e >= count:
        return
    model = now.wholes[slot, e, Whole.MODEL]
    controlled = now.wholes[slot, e, Whole.CONTROLLED]
    absent = now.wholes[slot, e, Whole.PRESENT] == 0 or now.wholes[slot, e, Whole.IMPOSED] != 0
    if model < 0 or controlled == 0 or absent:
        return
    base = tables.programs[program, ProgramColumn.ENTITY]
    road, lane = now.wholes[slot, e, Whole.ROAD], now.wholes[slot, e, Whole.LANE]
    s, t = now.reals[slot, e, Real.S], now.reals[slot, e, Real.T]
    speed = wp.max(now.reals[slot, e, Real.SPEED], ZERO)
    way = direction_of(now.reals[slot, e, Real.TURN])
    half_width = HALF * _OPEN_LANE_M
    middles = wp.vec3d(ZERO, FAR, FAR)
    lanes = wp.vec3i(lane, 0, 0)
    if road >= 0 and lane != 0:
        half_width = HALF * wp.max(lane_width(roads, road, lane, s), ONE)
        for side in range(3):
            target = lane
            if side > 0:
                target = lane_open(roads, road, s, lane, way * wp.where(side == 1, 1, -1))
            if target != 0:
                middle = lane_centre(roads, road, target, s)
                lanes[side] = target
                middles[side] = (middle[0] - t) * wp.float64(way)
    near = neighbours_of(tables, roads, before, slot, base, count, e, middles, half_width)
    if controlled & wp.int32(Domain.LONGITUDINAL) != 0:
        pull = follow_pull(tables, model, speed, near.gap_ahead[0], near.speed_ahead[0])
        pull = wp.max(pull, -tables.entity_reals[base + e, EntityColumn.DECELERATION_MAX])
        pull = wp.min(pull, tables.entity_reals[base + e, EntityColumn.ACCELERATION_MAX])
        speed = wp.max(speed + pull * step_s, ZERO)
        now.reals[slot, e, Real.SPEED] = speed
    if controlled & wp.int32(Domain.LATERAL) == 0 or road < 0:
        return
    span = tables.models[model, _DURATION]
    if now.wholes[slot, e, Whole.CHANGING] == 0 and tables.models[model, _POLITENESS] >= ZERO:
        length = tables.entity_reals[base + e, EntityColumn.LENGTH]
        best = wp.float64(0.0)
        choice = wp.int32(0)
        for side in range(1, 3):
            if lanes[side] != 0:
                gain = lane_gain(tables, before, slot, model, speed, length, near, side)
                if gain > best:
                    best = gain
                    choice = side
        if choice != 0 and step_s > ZERO:
            middle = lane_centre(roads, road, lanes[choice], s)
            now.wholes[slot, e, Whole.CHANGING] = lanes[choice]
            now.reals[slot, e, Real.CHANGE_FROM] = t - middle[0]
            now.reals[slot, e, Real.CHANGE_AT] = ZERO
    if now.wholes[slot, e, Whole.CHANGING] != 0:
        begin = now.reals[slot, e, Real.CHANGE_FROM]
        at = wp.min(now.reals[slot, e, Real.CHANGE_AT] + step_s, span)
        shape = wp.int32(DynamicsShape.CUBIC)
        rate = slope_at(shape, begin, ZERO, at, span)
        angle = portable_atan2(rate / not_zero(speed), ONE)
        if at >= span - CLOSE or speed < CLOSE:
            angle = ZERO
        now.wholes[slot, e, Whole.LANE] = now.wholes[slot, e, Whole.CHANGING]
        if at >= span - CLOSE:
            now.wholes[slot, e, Whole.CHANGING] = 0
        now.reals[slot, e, Real.CHANGE_AT] = at
        now.reals[slot, e, Real.OFFSET] = value_at(shape, begin, ZERO, at, span)
        now.reals[slot, e, Real.TURN] = turned(now.reals[slot, e, Real.TURN], angle)
