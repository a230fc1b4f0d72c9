"""Contact of hulls: oriented boxes in the plane, impulses with restitution and Coulomb friction.

Two boxes that overlap are pushed apart along the axis of least overlap, shared by inverse mass, and
meet in one point: the middle of the overlapping edge, weighted by depth. The impulse there stops
the approach (times 1 + e) and the sliding, friction permitting (Mirtich, Impulse-based Dynamic
Simulation, 3). With friction such an impulse can add energy at an eccentric contact; it is scaled
down to add none. Both sides get the same impulse: momentum is conserved to rounding.
"""

from __future__ import annotations

import warp as wp

from twin.vehicle.hull import Hull, hull_at

_ZERO = wp.constant(wp.float64(0.0))
_HALF = wp.constant(wp.float64(0.5))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_TINY = wp.constant(wp.float64(1.0e-12))
_REBOUND_MIN_MPS = wp.constant(wp.float64(0.3))
"""Slower approaches do not rebound [m/s]."""


@wp.struct
class RigidBox:
    """A hull as a rigid body in the plane; walls have inverse masses of 0."""

    x: wp.float64
    y: wp.float64
    """Centre of mass [m]."""
    yaw: wp.float64
    vx: wp.float64
    vy: wp.float64
    rate: wp.float64
    inverse_mass: wp.float64
    inverse_inertia: wp.float64
    offset: wp.float64
    """Centre of mass to the hull's centre, forward [m]."""
    half_length: wp.float64
    half_width: wp.float64
    restitution: wp.float64
    friction: wp.float64


@wp.struct
class Meeting:
    """Two boxes after their contact."""

    a: RigidBox
    b: RigidBox
    touched: wp.bool
    speed: wp.float64
    """Relative speed of the hulls at the point, before the impulse [m/s]."""
    approach: wp.float64
    """Its part along the normal, positive: towards each other [m/s]."""
    x: wp.float64
    y: wp.float64


@wp.func
def hull_of(a: RigidBox) -> Hull:
    """The hull of a body."""
    hull = hull_at(a.x, a.y, a.yaw, a.half_length, a.half_width)
    hull.x = a.x + a.offset * hull.c
    hull.y = a.y + a.offset * hull.s
    return hull


@wp.func
def _reach(h: Hull, c: wp.float64, s: wp.float64) -> wp.float64:
    """Half the shadow of a box on the axis (c, s) [m]."""
    return h.half_length * wp.abs(h.c * c + h.s * s) + h.half_width * wp.abs(h.c * s - h.s * c)


@wp.func
def _point(r: Hull, i: Hull, nx: wp.float64, ny: wp.float64, own: wp.float64) -> wp.vec2d:
    """Contact point on box ``r``, whose face with normal n (outwards) box ``i`` enters.

    ``own``: half size of ``r`` along its face. The two deepest corners of ``i`` span the edge that
    enters; it is cut to the face's width and to what is below the face.
    """
    tx = -ny
    ty = nx
    face = _reach(r, nx, ny)
    u0 = wp.float64(1.0e300)
    t0 = wp.float64(0.0)
    u1 = wp.float64(1.0e300)
    t1 = wp.float64(0.0)
    for k in range(4):
        along = wp.where(k < 2, i.half_length, -i.half_length)
        across = wp.where(k % 2 == 0, i.half_width, -i.half_width)
        px = i.x + along * i.c - across * i.s - r.x
        py = i.y + along * i.s + across * i.c - r.y
        u = px * nx + py * ny
        t = px * tx + py * ty
        if u < u0:
            u1 = u0
            t1 = t0
            u0 = u
            t0 = t
        elif u < u1:
            u1 = u
            t1 = t
    # Cut the edge (u0, t0) - (u1, t1) where it leaves the depth of the face and its width.
    if u1 > face and u1 - u0 > _TINY:
        t1 = t0 + (t1 - t0) * (face - u0) / (u1 - u0)
        u1 = face
    d0 = wp.max(face - u0, _TINY)
    d1 = wp.max(face - u1, _TINY)
    ta = wp.clamp(t0, -own, own)
    tb = wp.clamp(t1, -own, own)
    t = (ta * d0 + tb * d1) / (d0 + d1)
    return wp.vec2d(r.x + nx * face + tx * t, r.y + ny * face + ty * t)


@wp.func
def _impulse(
    a: RigidBox, b: RigidBox, px: wp.float64, py: wp.float64, nx: wp.float64, ny: wp.float64
):
    """Impulse on ``b`` (``a`` gets its opposite) at a point with normal n from a to b [N s]."""
    rax = px - a.x
    ray = py - a.y
    rbx = px - b.x
    rby = py - b.y
    vx = b.vx - b.rate * rby - a.vx + a.rate * ray
    vy = b.vy + b.rate * rbx - a.vy - a.rate * rax
    vn = vx * nx + vy * ny
    if vn >= _ZERO:
        return wp.vec2d(_ZERO, _ZERO)
    vt = vy * nx - vx * ny
    an = rax * ny - ray * nx
    bn = rbx * ny - rby * nx
    at = rax * nx + ray * ny
    bt = rbx * nx + rby * ny
    mass = a.inverse_mass + b.inverse_mass
    knn = mass + a.inverse_inertia * an * an + b.inverse_inertia * bn * bn
    ktt = mass + a.inverse_inertia * at * at + b.inverse_inertia * bt * bt
    knt = a.inverse_inertia * an * at + b.inverse_inertia * bn * bt
    bounce = wp.where(vn < -_REBOUND_MIN_MPS, wp.min(a.restitution, b.restitution), _ZERO)
    mu = wp.sqrt(a.friction * b.friction)
    # Sticking: both components of the relative velocity reach their target.
    want_n = -(_ONE + bounce) * vn
    want_t = -vt
    det = knn * ktt - knt * knt
    jn = (ktt * want_n - knt * want_t) / det
    jt = (knn * want_t - knt * want_n) / det
    if jn < _ZERO or wp.abs(jt) > mu * jn:
        side = wp.where(vt > _ZERO, -mu, mu)
        jn = want_n / wp.max(knn + side * knt, _HALF * knn)
        jt = side * jn
    gain = jn * vn + jt * vt
    square = _HALF * (knn * jn * jn + _TWO * knt * jn * jt + ktt * jt * jt)
    if gain + square > _ZERO:
        share = wp.clamp(-gain / square, _ZERO, _ONE)
        jn *= share
        jt *= share
    return wp.vec2d(jn * nx - jt * ny, jn * ny + jt * nx)


@wp.func
def _push(a: RigidBox, px: wp.float64, py: wp.float64, jx: wp.float64, jy: wp.float64) -> RigidBox:
    b = a
    b.vx = a.vx + jx * a.inverse_mass
    b.vy = a.vy + jy * a.inverse_mass
    b.rate = a.rate + ((px - a.x) * jy - (py - a.y) * jx) * a.inverse_inertia
    return b


@wp.func
def extent_of(b: RigidBox) -> wp.float64:
    """No corner of the hull is farther from the box's place than this [m]."""
    return b.half_length + b.half_width + wp.abs(b.offset)


@wp.func
def in_reach(
    ax: wp.float64, ay: wp.float64, bx: wp.float64, by: wp.float64, reach: wp.float64
) -> wp.bool:
    """Whether two hulls whose extents add up to ``reach`` can touch at all; cheap."""
    return wp.abs(ax - bx) < reach and wp.abs(ay - by) < reach


@wp.func
def near(a: RigidBox, b: RigidBox) -> wp.bool:
    """:func:`in_reach` of two boxes."""
    return in_reach(a.x, a.y, b.x, b.y, extent_of(a) + extent_of(b))


@wp.func
def meet(a: RigidBox, b: RigidBox) -> Meeting:
    """Contact of two boxes; they come back unchanged where they do not touch."""
    m = Meeting()
    m.a = a
    m.b = b
    ha = hull_of(a)
    hb = hull_of(b)
    best = wp.float64(-1.0e300)
    axis = wp.int32(0)
    for k in range(4):
        h = ha
        if k >= 2:
            h = hb
        c = wp.where(k % 2 == 0, h.c, -h.s)
        s = wp.where(k % 2 == 0, h.s, h.c)
        gap = wp.abs((hb.x - ha.x) * c + (hb.y - ha.y) * s) - _reach(ha, c, s) - _reach(hb, c, s)
        if gap > best:
            best = gap
            axis = k
    if best > _ZERO:
        return m
    m.touched = True
    h = ha
    if axis >= 2:
        h = hb
    nx = wp.where(axis % 2 == 0, h.c, -h.s)
    ny = wp.where(axis % 2 == 0, h.s, h.c)
    if (hb.x - ha.x) * nx + (hb.y - ha.y) * ny < _ZERO:
        nx = -nx
        ny = -ny
    if axis < 2:
        own = wp.where(axis == 0, ha.half_width, ha.half_length)
        p = _point(ha, hb, nx, ny, own)
    else:
        own = wp.where(axis == 2, hb.half_width, hb.half_length)
        p = _point(hb, ha, -nx, -ny, own)
    m.x = p[0]
    m.y = p[1]
    vx = b.vx - b.rate * (p[1] - b.y) - a.vx + a.rate * (p[1] - a.y)
    vy = b.vy + b.rate * (p[0] - b.x) - a.vy - a.rate * (p[0] - a.x)
    m.speed = wp.sqrt(vx * vx + vy * vy)
    m.approach = -(vx * nx + vy * ny)
    j = _impulse(a, b, p[0], p[1], nx, ny)
    m.a = _push(a, p[0], p[1], -j[0], -j[1])
    m.b = _push(b, p[0], p[1], j[0], j[1])
    total = a.inverse_mass + b.inverse_mass
    if total > _ZERO:
        m.a.x = m.a.x + nx * best * a.inverse_mass / total
        m.a.y = m.a.y + ny * best * a.inverse_mass / total
        m.b.x = m.b.x - nx * best * b.inverse_mass / total
        m.b.y = m.b.y - ny * best * b.inverse_mass / total
    return m
