"""The kernel of vehicles that somebody else moves. Contacts and measurements stay ours.

Between two poses a vehicle moves and turns evenly, step by step, so that it hits what is in between
and its speed, acceleration and turning rates follow from the poses alone. Wheels roll without slip.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_atan2
from twin.vehicle.chassis import observe, observe_motion
from twin.vehicle.kernel import VehicleScene, measure, mover_contacts, vehicle_contacts
from twin.vehicle.model import GRAVITY_MPS2, PHYSICS_STEP_NS, VehicleModel
from twin.vehicle.state import VehicleState

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

STAYS, GOES, JUMPS = 0, 1, 2
"""What becomes of a slot's vehicle: nothing; it moves evenly; it is put there, at rest."""

_STEP_S = wp.constant(wp.float64(PHYSICS_STEP_NS / 1e9))
_GRAVITY = wp.constant(wp.float64(GRAVITY_MPS2))
_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_TINY = wp.constant(wp.float64(1.0e-12))
_JUMPS = wp.constant(wp.int32(JUMPS))


@wp.func
def _blend(a: wp.quatd, b: wp.quatd, t: wp.float64) -> wp.quatd:
    """Between two orientations that are at most half a turn apart."""
    q = wp.quatd(
        a[0] + (b[0] - a[0]) * t,
        a[1] + (b[1] - a[1]) * t,
        a[2] + (b[2] - a[2]) * t,
        a[3] + (b[3] - a[3]) * t,
    )
    return wp.normalize(q)


@wp.func
def _rate(a: wp.quatd, b: wp.quatd, time_s: wp.float64) -> wp.vec3d:
    """Turning rate in vehicle axes that leads from ``a`` to ``b`` in this time [rad/s]."""
    d = wp.quat_inverse(a) * b
    v = wp.vec3d(d[0], d[1], d[2])
    sine = wp.length(v)
    if sine < _TINY:
        return wp.vec3d(_ZERO, _ZERO, _ZERO)
    return v * (_TWO * portable_atan2(sine, d[3]) / (sine * time_s))


@wp.kernel
def carry_kernel(
    # model
    models: wp.array(dtype=VehicleModel),
    model_of: wp.array2d(dtype=wp.int32),
    scene: VehicleScene,
    # args
    steps: wp.int32,
    first_step: wp.array(dtype=wp.int32),
    carried: wp.array(dtype=wp.int32),
    com: wp.array(dtype=wp.vec3d),
    turn: wp.array(dtype=wp.quatd),
    targets: wp.array(dtype=wp.int32),
    movers: wp.array3d(dtype=wp.float64),
    # state in and out
    states: wp.array2d(dtype=VehicleState),
    events: wp.array3d(dtype=wp.float64),
    counts: wp.array(dtype=wp.int32),
):
    """Move vehicle 0 of slots to ``com`` and ``turn``; ``carried`` says how."""
    slot = wp.tid()
    if carried[slot] == 0:
        return
    m = models[model_of[slot, 0]]
    before = states[slot, 0]
    begin = before.com
    a = before.orientation
    b = turn[slot]
    if wp.dot(a, b) < _ZERO:
        b = wp.quatd(-b[0], -b[1], -b[2], -b[3])
    time_s = wp.float64(steps) * _STEP_S
    velocity = (com[slot] - begin) / time_s
    rate = _rate(a, b, time_s)
    pull = (velocity - before.velocity) / time_s
    if carried[slot] == _JUMPS:
        begin = com[slot]
        a = b
        velocity = wp.vec3d(_ZERO, _ZERO, _ZERO)
        rate = velocity
        pull = velocity
    change = (rate - before.rate) / time_s
    for k in range(steps):
        s = states[slot, 0]
        frozen = scene.stop_at_impact != 0 and s.collisions > _ZERO
        if not frozen:
            now = wp.float64(first_step[slot] + k + 1)
            t = wp.float64(k + 1) / wp.float64(steps)
            s.com = begin + (com[slot] - begin) * t
            s.orientation = _blend(a, b, t)
            if k == steps - 1:
                s.com = com[slot]
                s.orientation = b
            s.velocity = velocity
            s.rate = rate
            s.rate_change = change
            s.held = _ZERO
            upward = wp.vec3d(pull[0], pull[1], pull[2] + _GRAVITY)
            s.specific_force = wp.quat_rotate_inv(s.orientation, upward)
            s.accel = wp.dot(pull, wp.quat_rotate(s.orientation, wp.vec3d(_ONE, _ZERO, _ZERO)))
            n = observe_motion(s)
            spin = n.speed / m.radius
            n.wheel_speed = wp.vec4d(spin, spin, spin, spin)
            n.wheel_angle = n.wheel_angle + n.wheel_speed * _STEP_S
            if n.speed != _ZERO:
                n.moved = _ONE
                n.rest_step = -_ONE
            elif n.moved > _ZERO and n.rest_step < _ZERO:
                n.rest_step = now
            states[slot, 0] = n
            vehicle_contacts(models, model_of, scene, states, events, counts, slot, 0, now)
            since = wp.float64(k + 1) * _STEP_S
            mover_contacts(m, scene, states, movers, events, counts, slot, 0, now, since)
    states[slot, 0] = measure(m, scene, observe(m, states[slot, 0]), targets[slot])
