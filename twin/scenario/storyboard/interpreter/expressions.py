"""Warp functions: expressions on entities, on the states at the beginning of a step."""

from __future__ import annotations

import warp as wp

from twin.road.walk.road_arrays import RoadArrays
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.boxes import box_of, overlapping
from twin.scenario.storyboard.interpreter.ground import (
    BodyPlace,
    front_of,
    place_of,
    resolved_place,
)
from twin.scenario.storyboard.interpreter.measures import (
    angle_of,
    axis_part,
    closing_speed,
    compared,
    distance_to,
    speed_beside,
    speed_of,
    turned_from,
)
from twin.scenario.storyboard.interpreter.transition import CLOSE, ZERO
from twin.scenario.storyboard.player.columns import Real, Whole
from twin.scenario.storyboard.player.kinds import kind_code
from twin.scenario.storyboard.player.layout import NO_PLACE, real_column, whole_column
from twin.scenario.storyboard.program import conditions as records
from twin.scenario.storyboard.program.conditions import (
    DistanceFrame,
    DistanceKind,
)
from twin.scenario.storyboard.program.entities import EntityCategory

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

_END_OF_ROAD = kind_code(records.EndOfRoadCondition)
_COLLISION = kind_code(records.CollisionCondition)
_OFFROAD = kind_code(records.OffroadCondition)
_HEADWAY = kind_code(records.TimeHeadwayCondition)
_TTC = kind_code(records.TimeToCollisionCondition)
_ACCELERATION = kind_code(records.AccelerationCondition)
_STAND_STILL = kind_code(records.StandStillCondition)
_SPEED = kind_code(records.SpeedCondition)
_RELATIVE_SPEED = kind_code(records.RelativeSpeedCondition)
_TRAVELED = kind_code(records.TraveledDistanceCondition)
_REACH = kind_code(records.ReachPositionCondition)
_DISTANCE = kind_code(records.DistanceCondition)
_RELATIVE_DISTANCE = kind_code(records.RelativeDistanceCondition)
_ANGLE = kind_code(records.AngleCondition)
_RELATIVE_ANGLE = kind_code(records.RelativeAngleCondition)

_COLLISION_ENTITY = whole_column(records.CollisionCondition, "entity")
_COLLISION_CATEGORY = whole_column(records.CollisionCondition, "category")
_ANGLE_VALUE = real_column(records.AngleCondition, "angle_rad")
_ANGLE_TOLERANCE = real_column(records.AngleCondition, "tolerance_rad")
_ANGLE_KIND = whole_column(records.AngleCondition, "kind")
_ANGLE_FRAME = whole_column(records.AngleCondition, "frame")
_BESIDE_ENTITY = whole_column(records.RelativeAngleCondition, "entity")
_BESIDE_KIND = whole_column(records.RelativeAngleCondition, "kind")
_BESIDE_VALUE = real_column(records.RelativeAngleCondition, "angle_rad")
_BESIDE_TOLERANCE = real_column(records.RelativeAngleCondition, "tolerance_rad")
_SPEED_RULE = whole_column(records.SpeedCondition, "rule")
_SPEED_AXIS = whole_column(records.SpeedCondition, "axis")
_PULL_RULE = whole_column(records.AccelerationCondition, "rule")
_PULL_AXIS = whole_column(records.AccelerationCondition, "axis")
_RELATIVE_ENTITY = whole_column(records.RelativeSpeedCondition, "entity")
_RELATIVE_RULE = whole_column(records.RelativeSpeedCondition, "rule")
_RELATIVE_AXIS = whole_column(records.RelativeSpeedCondition, "axis")
_REACH_TOLERANCE = real_column(records.ReachPositionCondition, "tolerance_m")

_DISTANCES = (
    (records.TimeHeadwayCondition, "value_s"),
    (records.TimeToCollisionCondition, "value_s"),
    (records.DistanceCondition, "value_m"),
    (records.RelativeDistanceCondition, "value_m"),
)


def _distance_columns(name: str) -> wp.vec4i:
    """Columns of one field of the four conditions on distances, -1 where there is none."""
    columns = []
    for record, value in _DISTANCES:
        field = value if name == "value" else name
        try:
            columns.append(
                real_column(record, field) if name == "value" else whole_column(record, field)
            )
        except ValueError:
            columns.append(-1)
    return wp.vec4i(*columns)


_FAR_VALUE = wp.constant(_distance_columns("value"))
_FAR_RULE = wp.constant(_distance_columns("rule"))
_FAR_ENTITY = wp.constant(_distance_columns("entity"))
_FAR_PLACE = wp.constant(_distance_columns("position.frame"))
_FAR_FRAME = wp.constant(_distance_columns("frame"))
_FAR_KIND = wp.constant(_distance_columns("kind"))
_FAR_FREE = wp.constant(_distance_columns("freespace"))
_NO_PLACE = wp.constant(wp.int32(NO_PLACE))
_DURATION_SLACK = wp.constant(wp.float64(1e-9))

# A record's first float and first position column, wherever there is just one.
assert real_column(records.ReachPositionCondition, "position.x_m") == 0
assert real_column(records.DistanceCondition, "position.x_m") == 0
assert real_column(records.TimeToCollisionCondition, "position.x_m") == 0
assert real_column(records.SpeedCondition, "value_mps") == 0


@wp.func
def lasted(since: wp.int32, step: wp.int32, step_s: wp.float64, duration: wp.float64) -> wp.bool:
    """True if something that began at the step ``since`` (-1: not) has lasted so long."""
    if since < 0:
        return False
    return wp.float64(step - since) * step_s >= duration - _DURATION_SLACK


@wp.func
def in_category(category: wp.int32, wanted: wp.int32) -> wp.bool:
    """True if a category is one of those meant: -1 any, -2 vehicles, -3 pedestrians, -4 others."""
    if wanted == -1:
        return True
    if wanted == -2:
        return category <= EntityCategory.TRAM
    if wanted == -3:
        return category >= EntityCategory.PEDESTRIAN and category <= EntityCategory.ANIMAL
    if wanted == -4:
        return category == EntityCategory.OBSTACLE
    return category == wanted


@wp.func
def hits(
    tables: ProgramArrays,
    bodies: BodyArrays,
    slot: wp.int32,
    base: wp.int32,
    count: wp.int32,
    e: wp.int32,
    entity: wp.int32,
    category: wp.int32,
) -> wp.bool:
    """True if the box of ``e`` touches that of an entity or of any of a category; bodies of one
    train, whose boxes may lie above one another, do not touch."""
    box = box_of(tables, bodies, slot, base + e, e)
    first = wp.where(entity >= 0, entity, 0)
    end = wp.where(entity >= 0, entity + 1, count)
    for other in range(first, end):
        wanted = other != e and bodies.wholes[slot, other, Whole.PRESENT] != 0
        if entity < 0:
            wanted = wanted and in_category(tables.entity_wholes[base + other, 0], category)
        if wanted and overlapping(box, box_of(tables, bodies, slot, base + other, other)):
            if front_of(bodies, slot, e) != front_of(bodies, slot, other):
                return True
    return False


@wp.func
def distance_holds(
    tables: ProgramArrays,
    bodies: BodyArrays,
    roads: RoadArrays,
    slot: wp.int32,
    base: wp.int32,
    e: wp.int32,
    kind: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
) -> wp.bool:
    """Conditions on distances, headways and times to collision.

    A headway is there if the other is ahead and the entity moves forwards; a time to collision, if
    the entities are apart and come nearer (as in esmini; the standard leaves it open).
    """
    which = wp.int32(0)
    if kind == _TTC:
        which = 1
    elif kind == _DISTANCE:
        which = 2
    elif kind == _RELATIVE_DISTANCE:
        which = 3
    frame = wp.int32(0)
    measure = wp.int32(DistanceKind.EUCLIDEAN)
    free = wp.int32(0)
    other = wp.int32(-1)
    if kind != _REACH:
        frame = tables.wholes[wholes + _FAR_FRAME[which]]
        measure = tables.wholes[wholes + _FAR_KIND[which]]
        free = tables.wholes[wholes + _FAR_FREE[which]]
        if _FAR_ENTITY[which] >= 0:
            other = tables.wholes[wholes + _FAR_ENTITY[which]]
    place = BodyPlace()
    other_row = wp.int32(-1)
    if other >= 0:
        if bodies.wholes[slot, other, Whole.PRESENT] == 0:
            return False
        place = place_of(bodies, slot, other)
        other_row = base + other
    else:
        first = wholes
        if kind != _REACH:
            first = wholes + _FAR_PLACE[which]
        if tables.wholes[first] == _NO_PLACE:
            return False
        place = resolved_place(tables, bodies, roads, slot, reals, first)
    far = distance_to(
        tables, bodies, roads, slot, base + e, e, place, other_row, other, frame, measure, free
    )
    if kind == _REACH:
        return far <= tables.reals[reals + _REACH_TOLERANCE] + CLOSE
    value = wp.abs(far)
    if kind == _HEADWAY:
        speed = bodies.reals[slot, e, Real.SPEED]
        if far < ZERO or speed < CLOSE:
            return False
        value = value / speed
    if kind == _TTC:
        closing = closing_speed(bodies, slot, e, other)
        if value < CLOSE or wp.abs(closing) < CLOSE or far * closing < ZERO:
            return False
        value = far / closing
    target = tables.reals[reals + _FAR_VALUE[which]]
    return compared(tables.wholes[wholes + _FAR_RULE[which]], value, target)


@wp.func
def entity_holds(
    tables: ProgramArrays,
    bodies: BodyArrays,
    roads: RoadArrays,
    slot: wp.int32,
    base: wp.int32,
    count: wp.int32,
    e: wp.int32,
    kind: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
    step: wp.int32,
    step_s: wp.float64,
) -> wp.bool:
    """True if one triggering entity fulfils an expression."""
    first = tables.reals[reals]
    if kind == _END_OF_ROAD:
        return lasted(bodies.wholes[slot, e, Whole.END_SINCE], step, step_s, first)
    if kind == _OFFROAD:
        return lasted(bodies.wholes[slot, e, Whole.OFF_SINCE], step, step_s, first)
    if kind == _STAND_STILL:
        return lasted(bodies.wholes[slot, e, Whole.STILL_SINCE], step, step_s, first)
    if kind == _COLLISION:
        entity = tables.wholes[wholes + _COLLISION_ENTITY]
        category = tables.wholes[wholes + _COLLISION_CATEGORY]
        return hits(tables, bodies, slot, base, count, e, entity, category)
    if kind == _ACCELERATION:
        pull = axis_part(bodies, slot, e, Real.AX, tables.wholes[wholes + _PULL_AXIS])
        return compared(tables.wholes[wholes + _PULL_RULE], pull, first)
    if kind == _SPEED:
        speed = speed_of(bodies, slot, e, tables.wholes[wholes + _SPEED_AXIS])
        return compared(tables.wholes[wholes + _SPEED_RULE], speed, first)
    if kind == _RELATIVE_SPEED:
        other = tables.wholes[wholes + _RELATIVE_ENTITY]
        speed = speed_beside(bodies, slot, e, other, tables.wholes[wholes + _RELATIVE_AXIS])
        return compared(tables.wholes[wholes + _RELATIVE_RULE], speed, first)
    if kind == _TRAVELED:
        return bodies.reals[slot, e, Real.TRAVELED] >= first
    if kind == _ANGLE:
        frame = tables.wholes[wholes + _ANGLE_FRAME]
        on_road = frame == DistanceFrame.ROAD or frame == DistanceFrame.LANE
        angle = angle_of(bodies, slot, e, tables.wholes[wholes + _ANGLE_KIND], on_road)
        apart = turned_from(angle, tables.reals[reals + _ANGLE_VALUE])
        return apart <= tables.reals[reals + _ANGLE_TOLERANCE]
    if kind == _RELATIVE_ANGLE:
        other = tables.wholes[wholes + _BESIDE_ENTITY]
        which = tables.wholes[wholes + _BESIDE_KIND]
        angle = angle_of(bodies, slot, e, which, False) - angle_of(
            bodies, slot, other, which, False
        )
        apart = turned_from(angle, tables.reals[reals + _BESIDE_VALUE])
        return apart <= tables.reals[reals + _BESIDE_TOLERANCE]
    return distance_holds(tables, bodies, roads, slot, base, e, kind, reals, wholes)
