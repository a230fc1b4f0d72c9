"""Rigid props that can be pushed: cones, bins, barriers. They slide and turn, but do not fall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from twin.vehicle.contact import RigidBox
from twin.vehicle.model import AIR_DENSITY_KGPM3, GRAVITY_MPS2

_ZERO = wp.constant(wp.float64(0.0))
_HALF_AIR = wp.constant(wp.float64(AIR_DENSITY_KGPM3 / 2))
_GRAVITY = wp.constant(wp.float64(GRAVITY_MPS2))


@dataclass(frozen=True, slots=True)
class PropKind:
    """A kind of prop."""

    length_m: float
    width_m: float
    mass_kg: float
    friction: float
    """On the road, over that of the weather's friction for tyres [-]."""
    drag_area_m2: float
    restitution: float = 0.2


PROPS: dict[str, PropKind] = {
    "cone": PropKind(0.36, 0.36, 3.2, 0.8, 0.16),
    "bin": PropKind(0.58, 0.53, 15.0, 0.6, 0.6),
    "barrier": PropKind(2.0, 0.45, 900.0, 0.8, 1.6, 0.05),
}
"""Traffic cone 75 cm, wheeled bin 120 l (EN 840), concrete barrier element."""

PROP_STATE = ("x_m", "y_m", "yaw_rad", "velocity_x_mps", "velocity_y_mps", "yaw_rate_radps")
"""Columns of a prop's state, float64 [S, P, 6]."""


@wp.struct
class PropModel:
    """Constants of one prop, SI."""

    half_length: wp.float64
    half_width: wp.float64
    mass: wp.float64
    inertia: wp.float64
    friction: wp.float64
    turn_arm: wp.float64
    """Friction torque over friction force while turning on the spot [m]."""
    drag_area: wp.float64
    restitution: wp.float64
    step: wp.float64


def prop_model(kind: PropKind, step_s: float) -> PropModel:
    """Constants of ``kind`` for kernels: a uniform box that presses evenly on its footprint."""
    model = PropModel()
    model.half_length, model.half_width = kind.length_m / 2, kind.width_m / 2
    model.mass, model.step = kind.mass_kg, step_s
    model.inertia = kind.mass_kg * (kind.length_m**2 + kind.width_m**2) / 12
    model.friction, model.drag_area = kind.friction, kind.drag_area_m2
    model.restitution = kind.restitution
    x = (np.arange(40) + 0.5) / 40 - 0.5
    arm = np.hypot(*np.meshgrid(x * kind.length_m, x * kind.width_m))
    model.turn_arm = float(arm.mean())
    return model


@wp.func
def prop_box(m: PropModel, state: wp.array3d(dtype=wp.float64), slot: int, prop: int) -> RigidBox:
    """A prop as a rigid body in the plane."""
    b = RigidBox()
    b.x = state[slot, prop, 0]
    b.y = state[slot, prop, 1]
    b.yaw = state[slot, prop, 2]
    b.vx = state[slot, prop, 3]
    b.vy = state[slot, prop, 4]
    b.rate = state[slot, prop, 5]
    b.inverse_mass = wp.float64(1.0) / m.mass
    b.inverse_inertia = wp.float64(1.0) / m.inertia
    b.half_length = m.half_length
    b.half_width = m.half_width
    b.restitution = m.restitution
    b.friction = wp.float64(0.3)
    return b


@wp.func
def write_prop(state: wp.array3d(dtype=wp.float64), slot: int, prop: int, b: RigidBox):
    """Keep a prop after a contact."""
    state[slot, prop, 0] = b.x
    state[slot, prop, 1] = b.y
    state[slot, prop, 3] = b.vx
    state[slot, prop, 4] = b.vy
    state[slot, prop, 5] = b.rate


@wp.func
def slide_prop(
    m: PropModel,
    state: wp.array3d(dtype=wp.float64),
    slot: int,
    prop: int,
    friction: wp.float64,
):
    """One step of a prop: dry friction that stops exactly, air drag, uniform motion."""
    vx = state[slot, prop, 3]
    vy = state[slot, prop, 4]
    rate = state[slot, prop, 5]
    speed = wp.sqrt(vx * vx + vy * vy)
    if speed == _ZERO and rate == _ZERO:
        return
    grip = m.friction * friction * _GRAVITY
    slower = grip + _HALF_AIR * m.drag_area * speed * speed / m.mass
    if speed > _ZERO:
        keep = wp.max(speed - slower * m.step, _ZERO) / speed
        vx *= keep
        vy *= keep
    brake = grip * m.mass * m.turn_arm / m.inertia * m.step
    rate = rate - wp.clamp(rate, -brake, brake)
    state[slot, prop, 0] = state[slot, prop, 0] + vx * m.step
    state[slot, prop, 1] = state[slot, prop, 1] + vy * m.step
    state[slot, prop, 2] = state[slot, prop, 2] + rate * m.step
    state[slot, prop, 3] = vx
    state[slot, prop, 4] = vy
    state[slot, prop, 5] = rate
