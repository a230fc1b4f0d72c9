"""Warp functions: what conditions measure on one entity, on the states at the beginning of a step.

Free-space distances along an axis are the gap between the extents of both boxes along it, 0 where
those overlap (ASAM OpenSCENARIO XML 1.3, 7.4.5); along a road the axis is the road's direction at
each of them. Without free space the entities' origins count.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_cos, portable_sin
from twin.road.walk.distances import road_apart
from twin.road.walk.road_arrays import RoadArrays
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.boxes import (
    PlaneBox,
    box_of,
    boxes_apart,
    gap_along,
    reach_of,
)
from twin.scenario.storyboard.interpreter.ground import BodyPlace, direction_of, wrapped
from twin.scenario.storyboard.interpreter.transition import CLOSE, FAR, ONE, PI, ZERO, sign_of
from twin.scenario.storyboard.player.columns import Real, Whole
from twin.scenario.storyboard.program.conditions import (
    AngleKind,
    ComparisonRule,
    DistanceFrame,
    DistanceKind,
    SpeedAxis,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

UNDEFINED = wp.constant(wp.float64(-1e300))
"""What a measure is that does not exist: no rule holds for it."""


@wp.func
def compared(rule: wp.int32, value: wp.float64, target: wp.float64) -> wp.bool:
    """True if a rule holds; values that differ by less than ``CLOSE`` are equal."""
    equal = wp.abs(value - target) < CLOSE
    if rule == ComparisonRule.GREATER:
        return value > target + CLOSE
    if rule == ComparisonRule.LESS:
        return value < target - CLOSE
    if rule == ComparisonRule.GREATER_OR_EQUAL:
        return value >= target - CLOSE
    if rule == ComparisonRule.LESS_OR_EQUAL:
        return value <= target + CLOSE
    if rule == ComparisonRule.NOT_EQUAL:
        return not equal
    return equal


@wp.func
def axis_part(bodies: BodyArrays, slot: wp.int32, e: wp.int32, first: wp.int32, axis: wp.int32):
    """Component of the vector in columns ``first`` on, in the axes of entity ``e``."""
    x = bodies.reals[slot, e, first]
    y = bodies.reals[slot, e, first + 1]
    z = bodies.reals[slot, e, first + 2]
    if axis == SpeedAxis.VERTICAL:
        return z
    if axis == SpeedAxis.TOTAL:
        return wp.sqrt(x * x + y * y + z * z)
    heading = bodies.reals[slot, e, Real.HEADING]
    cosine, sine = portable_cos(heading), portable_sin(heading)
    if axis == SpeedAxis.LONGITUDINAL:
        return x * cosine + y * sine
    return y * cosine - x * sine


@wp.func
def speed_of(bodies: BodyArrays, slot: wp.int32, e: wp.int32, axis: wp.int32) -> wp.float64:
    """Speed of an entity; in total it has the sign of its direction."""
    if axis == SpeedAxis.TOTAL:
        return bodies.reals[slot, e, Real.SPEED]
    return axis_part(bodies, slot, e, Real.VX, axis)


@wp.func
def speed_beside(
    bodies: BodyArrays, slot: wp.int32, e: wp.int32, other: wp.int32, axis: wp.int32
) -> wp.float64:
    """Speed of an entity minus that of another, in the axes of the other as esmini has it."""
    if axis == SpeedAxis.TOTAL:
        return bodies.reals[slot, e, Real.SPEED] - bodies.reals[slot, other, Real.SPEED]
    heading = bodies.reals[slot, other, Real.HEADING]
    cosine, sine = portable_cos(heading), portable_sin(heading)
    x = bodies.reals[slot, e, Real.VX] - bodies.reals[slot, other, Real.VX]
    y = bodies.reals[slot, e, Real.VY] - bodies.reals[slot, other, Real.VY]
    if axis == SpeedAxis.LONGITUDINAL:
        return x * cosine + y * sine
    if axis == SpeedAxis.LATERAL:
        return y * cosine - x * sine
    return bodies.reals[slot, e, Real.VZ] - bodies.reals[slot, other, Real.VZ]


@wp.func
def gap_on_road(
    one: PlaneBox, heading: wp.float64, other: PlaneBox, other_heading: wp.float64, ways: wp.vec2d
) -> wp.vec2d:
    """Gaps of two boxes along and across their road, whose origins are ``ways`` apart.

    Args:
        one: box about the origin of its body.
        heading: of the road there.
        other: the same of the other body.
        other_heading: of the road there.
        ways: ds and dt from one origin to the other.
    """
    gaps = wp.vec2d(ZERO, ZERO)
    for axis in range(2):
        cosine, sine = portable_cos(heading), portable_sin(heading)
        far_cosine, far_sine = portable_cos(other_heading), portable_sin(other_heading)
        x = wp.where(axis == 0, cosine, -sine)
        y = wp.where(axis == 0, sine, cosine)
        far_x = wp.where(axis == 0, far_cosine, -far_sine)
        far_y = wp.where(axis == 0, far_sine, far_cosine)
        between = ways[axis] + other.x * far_x + other.y * far_y - one.x * x - one.y * y
        free = wp.abs(between) - reach_of(one, x, y) - reach_of(other, far_x, far_y)
        gaps[axis] = wp.where(free > ZERO, sign_of(between) * free, ZERO)
    return gaps


@wp.func
def distance_to(
    tables: ProgramArrays,
    bodies: BodyArrays,
    roads: RoadArrays,
    slot: wp.int32,
    row: wp.int32,
    e: wp.int32,
    other: BodyPlace,
    other_row: wp.int32,
    other_entity: wp.int32,
    frame: wp.int32,
    kind: wp.int32,
    freespace: wp.int32,
) -> wp.float64:
    """Signed distance from entity ``e`` to a place: ahead and to the left positive.

    Args:
        tables: programs.
        bodies: states.
        roads: the network.
        slot: whose.
        row: of the entity in the tables.
        e: the entity.
        other: the place.
        other_row: of the entity there in the tables; -1: a point.
        other_entity: the entity there.
        frame: coordinate system.
        kind: what is measured.
        freespace: 1: between boxes.

    Returns:
        the distance; ``FAR`` where no way leads there.
    """
    x, y = bodies.reals[slot, e, Real.X], bodies.reals[slot, e, Real.Y]
    one = box_of(tables, bodies, slot, row, e)
    target = PlaneBox()
    target.x = other.x
    target.y = other.y
    target.z = other.z
    target.cosine = ONE
    if other_row >= 0:
        target = box_of(tables, bodies, slot, other_row, other_entity)
    if kind == DistanceKind.EUCLIDEAN:
        if freespace != 0:
            return boxes_apart(one, target)
        return wp.sqrt((other.x - x) * (other.x - x) + (other.y - y) * (other.y - y))
    road = bodies.wholes[slot, e, Whole.ROAD]
    on_road = frame == DistanceFrame.ROAD or frame == DistanceFrame.LANE
    if on_road and road >= 0 and other.road >= 0:
        s, t = bodies.reals[slot, e, Real.S], bodies.reals[slot, e, Real.T]
        apart = road_apart(roads, road, s, t, other.road, other.s, other.t)
        if apart.reached == 0:
            return FAR
        sign = wp.float64(direction_of(bodies.reals[slot, e, Real.TURN]))
        ways = wp.vec2d(apart.ds, apart.dt)
        if freespace != 0:
            heading = bodies.reals[slot, e, Real.ROAD_HEADING]
            far_heading = other.road_heading + wp.where(apart.sign < 0, PI, ZERO)
            one.x -= x
            one.y -= y
            target.x -= other.x
            target.y -= other.y
            ways = gap_on_road(one, heading, target, far_heading, ways)
        return sign * wp.where(kind == DistanceKind.LONGITUDINAL, ways[0], ways[1])
    cosine = wp.where(frame == DistanceFrame.WORLD, ONE, one.cosine)
    sine = wp.where(frame == DistanceFrame.WORLD, ZERO, one.sine)
    axis_x = wp.where(kind == DistanceKind.LONGITUDINAL, cosine, -sine)
    axis_y = wp.where(kind == DistanceKind.LONGITUDINAL, sine, cosine)
    if freespace != 0:
        return gap_along(one, target, axis_x, axis_y)
    return (other.x - x) * axis_x + (other.y - y) * axis_y


@wp.func
def closing_speed(bodies: BodyArrays, slot: wp.int32, e: wp.int32, other: wp.int32) -> wp.float64:
    """How fast an entity comes nearer to another that is ahead of it, as esmini has it: its
    velocity along that of the other, less the other's speed; its own speed if the other stands."""
    speed = bodies.reals[slot, e, Real.SPEED]
    if other < 0:
        return speed
    vx, vy = bodies.reals[slot, other, Real.VX], bodies.reals[slot, other, Real.VY]
    if wp.abs(vx) < CLOSE and wp.abs(vy) < CLOSE:
        return speed
    own = bodies.reals[slot, e, Real.VX] * vx + bodies.reals[slot, e, Real.VY] * vy
    along = own / wp.sqrt(vx * vx + vy * vy)
    fast = wp.abs(bodies.reals[slot, other, Real.SPEED])
    return sign_of(speed) * sign_of(along) * (along - fast)


@wp.func
def angle_of(bodies: BodyArrays, slot: wp.int32, e: wp.int32, kind: wp.int32, on_road: wp.bool):
    """An angle of a body, relative to the road's direction if ``on_road``."""
    if kind == AngleKind.PITCH:
        return bodies.reals[slot, e, Real.PITCH]
    if kind == AngleKind.ROLL:
        return bodies.reals[slot, e, Real.ROLL]
    heading = bodies.reals[slot, e, Real.HEADING]
    if on_road:
        return wrapped(heading - bodies.reals[slot, e, Real.ROAD_HEADING])
    return heading


@wp.func
def turned_from(angle: wp.float64, target: wp.float64) -> wp.float64:
    """How far an angle is from another, at least 0."""
    return wp.abs(wrapped(angle - target))
