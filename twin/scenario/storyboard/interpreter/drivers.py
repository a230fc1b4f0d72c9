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
class SeenLane:
    """A lane as its driver, or the driver beside it, sees it."""

    lane: wp.int32
    """Id; 0: nobody may drive there."""
    middle: wp.float64
    """How far to the left of the driver its middle is [m]."""


@wp.struct
class LaneNeighbours:
    """Who is next ahead and behind in a lane."""

    gap_ahead: wp.float64
    """At least ``FAR``: nobody."""
    speed_ahead: wp.float64
    gap_behind: wp.float64
    speed_behind: wp.float64
    behind: wp.int32
    """Entity; -1: none."""


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


@wp.struct
class ThreeLanes:
    """The neighbours in the own lane, the left and the right one."""

    own: LaneNeighbours
    left: LaneNeighbours
    right: LaneNeighbours


@wp.func
def nobody_near() -> LaneNeighbours:
    """An empty lane."""
    near = LaneNeighbours()
    near.gap_ahead = FAR
    near.gap_behind = FAR
    near.behind = -1
    return near


@wp.func
def nearer(
    near: LaneNeighbours,
    other: wp.int32,
    ahead: wp.float64,
    speed: wp.float64,
    gap_ahead: wp.float64,
    gap_behind: wp.float64,
) -> LaneNeighbours:
    """The neighbours in a lane, with one more body in it; it is ahead by its origin."""
    if ahead >= ZERO:
        if gap_ahead < near.gap_ahead:
            near.gap_ahead = gap_ahead
            near.speed_ahead = speed
    elif gap_behind < near.gap_behind:
        near.gap_behind = gap_behind
        near.speed_behind = speed
        near.behind = other
    return near


@wp.func
def neighbours_of(
    tables: ProgramArrays,
    roads: RoadArrays,
    before: BodyArrays,
    slot: wp.int32,
    base: wp.int32,
    count: wp.int32,
    e: wp.int32,
    own: SeenLane,
    left: SeenLane,
    right: SeenLane,
    half_width: wp.float64,
) -> ThreeLanes:
    """The neighbours of a body in three lanes."""
    lanes = ThreeLanes()
    lanes.own = nobody_near()
    lanes.left = nobody_near()
    lanes.right = nobody_near()
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
                gap_ahead = seen.ahead - front - far_rear
                gap_behind = -seen.ahead - rear - far_front
                if wp.abs(seen.left - own.middle) < half_width:
                    lanes.own = nearer(
                        lanes.own, other, seen.ahead, seen.speed, gap_ahead, gap_behind
                    )
                if left.lane != 0 and wp.abs(seen.left - left.middle) < half_width:
                    lanes.left = nearer(
                        lanes.left, other, seen.ahead, seen.speed, gap_ahead, gap_behind
                    )
                if right.lane != 0 and wp.abs(seen.left - right.middle) < half_width:
                    lanes.right = nearer(
                        lanes.right, other, seen.ahead, seen.speed, gap_ahead, gap_behind
                    )
    return lanes


@wp.func
def model_row(
    tables: ProgramArrays, bodies: BodyArrays, slot: wp.int32, program: wp.int32, e: wp.int32
) -> wp.int32:
    """The row of the driver model that an entity has, -1: none."""
    model = bodies.wholes[slot, e, Whole.MODEL]
    if model < 0:
        return -1
    return tables.programs[program, ProgramColumn.MODEL] + model


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
    program: wp.int32,
    model: wp.int32,
    speed: wp.float64,
    length: wp.float64,
    own: LaneNeighbours,
    there: LaneNeighbours,
) -> wp.float64:
    """How much more than the threshold a change gains; negative if it is not to be."""
    pull = follow_pull(tables, model, speed, there.gap_ahead, there.speed_ahead)
    gain = pull - follow_pull(tables, model, speed, own.gap_ahead, own.speed_ahead)
    if wp.min(there.gap_ahead, there.gap_behind) < _GAP_LEAST:
        return -ONE
    others = wp.float64(0.0)
    if there.behind >= 0:
        rule = model_row(tables, before, slot, program, there.behind)
        if rule < 0:
            rule = model
        free = there.gap_behind + length + there.gap_ahead
        after = follow_pull(tables, rule, there.speed_behind, there.gap_behind, speed)
        if after < -tables.models[model, _SAFE]:
            return -ONE
        others += after - follow_pull(tables, rule, there.speed_behind, free, there.speed_ahead)
    if own.behind >= 0:
        rule = model_row(tables, before, slot, program, own.behind)
        if rule < 0:
            rule = model
        free = own.gap_behind + length + own.gap_ahead
        after = follow_pull(tables, rule, own.speed_behind, free, own.speed_ahead)
        others += after - follow_pull(tables, rule, own.speed_behind, own.gap_behind, speed)
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


@wp.func
def view_of(
    roads: RoadArrays,
    road: wp.int32,
    s: wp.float64,
    t: wp.float64,
    lane: wp.int32,
    way: wp.int32,
) -> SeenLane:
    """A lane as seen from a place by a driver who goes along s, or against it (``way`` -1)."""
    view = SeenLane()
    view.lane = lane
    view.middle = FAR
    if lane != 0:
        middle = lane_centre(roads, road, lane, s)
        view.middle = (middle[0] - t) * wp.float64(way)
    return view


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
    model = model_row(tables, now, slot, program, e)
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
    own, left, right = SeenLane(), SeenLane(), SeenLane()
    own.lane = lane
    if road >= 0 and lane != 0:
        half_width = HALF * wp.max(lane_width(roads, road, lane, s), ONE)
        own = view_of(roads, road, s, t, lane, way)
        left = view_of(roads, road, s, t, lane_open(roads, road, s, lane, way), way)
        right = view_of(roads, road, s, t, lane_open(roads, road, s, lane, -way), way)
    near = neighbours_of(tables, roads, before, slot, base, count, e, own, left, right, half_width)
    if controlled & wp.int32(Domain.LONGITUDINAL) != 0:
        pull = follow_pull(tables, model, speed, near.own.gap_ahead, near.own.speed_ahead)
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
        chosen = SeenLane()
        if left.lane != 0:
            gain = lane_gain(
                tables, before, slot, program, model, speed, length, near.own, near.left
            )
            if gain > best:
                best = gain
                chosen = left
        if right.lane != 0:
            gain = lane_gain(
                tables, before, slot, program, model, speed, length, near.own, near.right
            )
            if gain > best:
                chosen = right
        if chosen.lane != 0 and step_s > ZERO:
            now.wholes[slot, e, Whole.CHANGING] = chosen.lane
            now.reals[slot, e, Real.CHANGE_FROM] = -chosen.middle * wp.float64(way)
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
