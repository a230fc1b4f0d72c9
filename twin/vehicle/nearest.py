"""What the ego is nearest to: distance and time to collision over every hull, once per tick.

A kernel of its own, because the physics step is the one thing that must be fast: there only what
may touch is looked at, here everything. The time to collision is exact for two boxes that go on
straight at constant velocity without turning: on each of their four axes their shadows overlap
from a time on and until another; they collide when all four do (Gottschalk's separating axes,
swept).
"""

from __future__ import annotations

import warp as wp

from twin.vehicle.hull import Hull, hull_at, separation
from twin.vehicle.model import VehicleModel
from twin.vehicle.state import VehicleState

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NEAREST = ("distance_m", "distance_index", "ttc_s", "ttc_index")
"""Columns of what was measured, float64 [S, 4]; index -1: there is none."""

_ZERO = wp.constant(wp.float64(0.0))
_NEVER = wp.constant(wp.float64(1.0e300))
_CLOSING_MIN_MPS = wp.constant(wp.float64(0.05))
"""Hulls that move slower against each other have no time to collision [m/s]."""


@wp.struct
class NearestSoFar:
    """The least of what has been looked at."""

    distance: wp.float64
    distance_index: wp.int32
    ttc: wp.float64
    ttc_index: wp.int32


@wp.func
def _reach(h: Hull, c: wp.float64, s: wp.float64) -> wp.float64:
    """Half the shadow of a box on the axis (c, s) [m]."""
    return h.half_length * wp.abs(h.c * c + h.s * s) + h.half_width * wp.abs(h.c * s - h.s * c)


@wp.func
def contact_time(a: Hull, b: Hull, vx: wp.float64, vy: wp.float64) -> wp.float64:
    """When two boxes touch if ``a`` goes on with velocity (vx, vy) against ``b`` [s]; 0 where they
    overlap, 1e300: never."""
    enter = -_NEVER
    leave = _NEVER
    for k in range(4):
        c = a.c
        s = a.s
        if k >= 2:
            c = b.c
            s = b.s
        if k % 2 == 1:
            along = c
            c = -s
            s = along
        offset = (b.x - a.x) * c + (b.y - a.y) * s
        reach = _reach(a, c, s) + _reach(b, c, s)
        speed = vx * c + vy * s
        if speed == _ZERO:
            if wp.abs(offset) > reach:
                return _NEVER
        else:
            one = (offset - reach) / speed
            other = (offset + reach) / speed
            enter = wp.max(enter, wp.min(one, other))
            leave = wp.min(leave, wp.max(one, other))
    if enter > leave or leave < _ZERO:
        return _NEVER
    # Of -0.0 and 0.0 a CPU and a GPU take different ones; the sum is 0.0 of both.
    return wp.max(enter, _ZERO) + _ZERO


@wp.func
def _closer(
    best: NearestSoFar, a: Hull, b: Hull, vx: wp.float64, vy: wp.float64, index: wp.int32
) -> NearestSoFar:
    """``best``, or hull ``b`` where it is nearer; ``a`` moves with (vx, vy) against it."""
    n = best
    dx = b.x - a.x
    dy = b.y - a.y
    # No corner is farther from its centre than length and width together.
    least = wp.sqrt(dx * dx + dy * dy) - a.half_length - a.half_width - b.half_length - b.half_width
    if least < n.distance:
        way = separation(a, b)
        if way[2] < n.distance:
            n.distance = way[2]
            n.distance_index = index
    speed = wp.sqrt(vx * vx + vy * vy)
    if speed > _CLOSING_MIN_MPS and least < n.ttc * speed:
        ttc = contact_time(a, b, vx, vy)
        if ttc < n.ttc:
            n.ttc = ttc
            n.ttc_index = index
    return n


@wp.kernel
def nearest_kernel(
    # model
    models: wp.array(dtype=VehicleModel),
    model_of: wp.array2d(dtype=wp.int32),
    walls: wp.array2d(dtype=wp.float64),
    # state in
    active: wp.array(dtype=wp.int32),
    states: wp.array2d(dtype=VehicleState),
    movers: wp.array3d(dtype=wp.float64),
    # out
    nearest_out: wp.array2d(dtype=wp.float64),
):
    """The nearest hull to every slot's vehicle 0, and the one it would hit first.

    Indices count ``walls`` [K, 5], then ``movers`` [S, M, 8]; of equally near ones the first
    counts.
    """
    slot = wp.tid()
    n = NearestSoFar()
    n.distance = _NEVER
    n.distance_index = -1
    n.ttc = _NEVER
    n.ttc_index = -1
    if active[slot] != 0:
        m = models[model_of[slot, 0]]
        s = states[slot, 0]
        a = hull_at(s.com[0], s.com[1], s.yaw, m.half_length, m.half_width)
        a.x = s.com[0] + m.hull_x * a.c
        a.y = s.com[1] + m.hull_x * a.s
        vx = s.velocity[0]
        vy = s.velocity[1]
        count = walls.shape[0]
        for k in range(count):
            b = hull_at(walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3], walls[k, 4])
            n = _closer(n, a, b, vx, vy, k)
        for k in range(movers.shape[1]):
            if movers[slot, k, 3] > _ZERO:
                b = hull_at(
                    movers[slot, k, 0],
                    movers[slot, k, 1],
                    movers[slot, k, 2],
                    movers[slot, k, 3],
                    movers[slot, k, 4],
                )
                n = _closer(n, a, b, vx - movers[slot, k, 5], vy - movers[slot, k, 6], count + k)
    nearest_out[slot, 0] = n.distance
    nearest_out[slot, 1] = wp.float64(n.distance_index)
    nearest_out[slot, 2] = n.ttc
    nearest_out[slot, 3] = wp.float64(n.ttc_index)
