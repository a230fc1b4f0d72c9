"""Oriented boxes in the plane: overlap and distance, in kernels."""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_turn


@wp.struct
class Hull:
    """An oriented box: centre, unit vector along it, half length and half width [m]."""

    x: wp.float64
    y: wp.float64
    c: wp.float64
    s: wp.float64
    half_length: wp.float64
    half_width: wp.float64


@wp.func
def hull_at(
    x: wp.float64, y: wp.float64, yaw: wp.float64, half_length: wp.float64, half_width: wp.float64
) -> Hull:
    """The box centred on (x, y) [m] and turned by ``yaw`` [rad]."""
    hull = Hull()
    hull.x = x
    hull.y = y
    ahead = portable_turn(yaw)
    hull.c = ahead[0]
    hull.s = ahead[1]
    hull.half_length = half_length
    hull.half_width = half_width
    return hull


@wp.func
def _gap_along(a: Hull, b: Hull, c: wp.float64, s: wp.float64) -> wp.float64:
    """Gap between the boxes' shadows on the axis (c, s); negative: they overlap there [m]."""
    offset = wp.abs((b.x - a.x) * c + (b.y - a.y) * s)
    reach = a.half_length * wp.abs(a.c * c + a.s * s) + a.half_width * wp.abs(a.c * s - a.s * c)
    reach += b.half_length * wp.abs(b.c * c + b.s * s) + b.half_width * wp.abs(b.c * s - b.s * c)
    return offset - reach


@wp.func
def overlap(a: Hull, b: Hull) -> wp.bool:
    """Whether two boxes overlap or touch (separating axes)."""
    gap = wp.max(_gap_along(a, b, a.c, a.s), _gap_along(a, b, -a.s, a.c))
    gap = wp.max(gap, wp.max(_gap_along(a, b, b.c, b.s), _gap_along(a, b, -b.s, b.c)))
    return gap <= wp.float64(0.0)


@wp.func
def _nearest_corner(a: Hull, b: Hull) -> wp.vec3d:
    """Shortest way from box ``a`` to a corner of ``b``: its world x, y and squared length."""
    best = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0e300))
    for i in range(4):
        along = wp.where(i < 2, b.half_length, -b.half_length)
        across = wp.where(i % 2 == 0, b.half_width, -b.half_width)
        dx = b.x + along * b.c - across * b.s - a.x
        dy = b.y + along * b.s + across * b.c - a.y
        # The corner in a's axes, and how far it lies outside a.
        u = dx * a.c + dy * a.s
        v = dy * a.c - dx * a.s
        u = u - wp.clamp(u, -a.half_length, a.half_length)
        v = v - wp.clamp(v, -a.half_width, a.half_width)
        square = u * u + v * v
        if square < best[2]:
            best = wp.vec3d(u * a.c - v * a.s, u * a.s + v * a.c, square)
    return best


@wp.func
def separation(a: Hull, b: Hull) -> wp.vec3d:
    """Shortest way from box ``a`` to box ``b``: world x, y and length [m]; zeros on overlap.

    Two convex polygons that do not overlap are nearest at a corner of one of them.
    """
    if overlap(a, b):
        return wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    there = _nearest_corner(a, b)
    back = _nearest_corner(b, a)
    if back[2] < there[2]:
        there = wp.vec3d(-back[0], -back[1], back[2])
    return wp.vec3d(there[0], there[1], wp.sqrt(there[2]))
