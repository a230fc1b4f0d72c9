"""Warp functions: boxes of entities in the plane, whether they overlap and how far apart they are.

Overlap is told by separating axes (Gottschalk, Lin, Manocha 1996, SIGGRAPH): two rectangles are
apart exactly if they are along the normal of one of their sides.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_cos, portable_sin
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.transition import CLOSE, HALF, ONE, ZERO
from twin.scenario.storyboard.player.columns import EntityColumn, Real

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

STOREY_M = wp.constant(wp.float64(2.5))
"""Boxes whose origins differ more in height do not touch [m]."""
_FAR = wp.constant(wp.float64(1e300))


@wp.struct
class PlaneBox:
    """An oriented rectangle: centre, unit vector forwards and half extents."""

    x: wp.float64
    y: wp.float64
    z: wp.float64
    cosine: wp.float64
    sine: wp.float64
    length: wp.float64
    """Half of it [m]."""
    width: wp.float64
    """Half of it [m]."""


@wp.func
def box_of(tables: ProgramArrays, bodies: BodyArrays, slot: wp.int32, row: wp.int32, e: wp.int32):
    """The box of an entity; ``row`` is its row in the tables."""
    box = PlaneBox()
    heading = bodies.reals[slot, e, Real.HEADING]
    box.cosine = portable_cos(heading)
    box.sine = portable_sin(heading)
    ahead = tables.entity_reals[row, EntityColumn.CENTRE_X]
    left = tables.entity_reals[row, EntityColumn.CENTRE_Y]
    box.x = bodies.reals[slot, e, Real.X] + box.cosine * ahead - box.sine * left
    box.y = bodies.reals[slot, e, Real.Y] + box.sine * ahead + box.cosine * left
    box.z = bodies.reals[slot, e, Real.Z]
    box.length = HALF * tables.entity_reals[row, EntityColumn.LENGTH]
    box.width = HALF * tables.entity_reals[row, EntityColumn.WIDTH]
    return box


@wp.func
def point_box(x: wp.float64, y: wp.float64, z: wp.float64):
    """A box without extent."""
    box = PlaneBox()
    box.x = x
    box.y = y
    box.z = z
    box.cosine = ONE
    return box


@wp.func
def reach_of(box: PlaneBox, x: wp.float64, y: wp.float64) -> wp.float64:
    """Half of the extent of a box along a unit vector."""
    along = wp.abs(x * box.cosine + y * box.sine)
    across = wp.abs(y * box.cosine - x * box.sine)
    return along * box.length + across * box.width


@wp.func
def gap_along(one: PlaneBox, other: PlaneBox, x: wp.float64, y: wp.float64) -> wp.float64:
    """Signed gap between the extents of two boxes along a unit vector: how far the other is ahead
    (positive) or behind, 0 where they overlap along it."""
    between = (other.x - one.x) * x + (other.y - one.y) * y
    free = wp.abs(between) - reach_of(one, x, y) - reach_of(other, x, y)
    if free <= ZERO:
        return ZERO
    return wp.where(between < ZERO, -free, free)


@wp.func
def overlapping(one: PlaneBox, other: PlaneBox) -> wp.bool:
    """True if two boxes touch."""
    if wp.abs(one.z - other.z) > STOREY_M:
        return False
    free = wp.abs(gap_along(one, other, one.cosine, one.sine))
    free = wp.max(free, wp.abs(gap_along(one, other, -one.sine, one.cosine)))
    free = wp.max(free, wp.abs(gap_along(one, other, other.cosine, other.sine)))
    free = wp.max(free, wp.abs(gap_along(one, other, -other.sine, other.cosine)))
    return free <= CLOSE


@wp.func
def corners_to(one: PlaneBox, other: PlaneBox) -> wp.float64:
    """Smallest distance of a corner of one box from the other."""
    least = _FAR
    for corner in range(4):
        ahead = wp.where(corner < 2, one.length, -one.length)
        left = wp.where(corner % 2 == 0, one.width, -one.width)
        dx = one.x + one.cosine * ahead - one.sine * left - other.x
        dy = one.y + one.sine * ahead + one.cosine * left - other.y
        along = wp.max(wp.abs(dx * other.cosine + dy * other.sine) - other.length, ZERO)
        across = wp.max(wp.abs(dy * other.cosine - dx * other.sine) - other.width, ZERO)
        least = wp.min(least, wp.sqrt(along * along + across * across))
    return least


@wp.func
def boxes_apart(one: PlaneBox, other: PlaneBox) -> wp.float64:
    """Distance of two boxes, 0 where they touch: of boxes apart it is that of some corner."""
    if overlapping(one, other):
        return ZERO
    return wp.min(corners_to(one, other), corners_to(other, one))
