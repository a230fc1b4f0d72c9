"""State of a vehicle: one Warp struct, and the same memory as columns of float64.

Kernels read and write :class:`VehicleState` by name; the host sees ``float64 [S, V, T]``, slot
first, and finds a value by :data:`COLUMN`. Wheels come front left, front right, rear left, rear
right. World and vehicle axes: x forward (along the street), y left, z up.
"""

from __future__ import annotations

import warp as wp


@wp.struct
class VehicleState:
    """Everything of one vehicle that changes. Only float64, so that it is also a row of columns."""

    x: wp.float64
    y: wp.float64
    yaw: wp.float64
    z: wp.float64
    roll: wp.float64
    pitch: wp.float64
    speed: wp.float64
    accel: wp.float64
    yaw_rate: wp.float64
    steering: wp.float64
    throttle: wp.float64
    brake: wp.float64
    handbrake: wp.float64
    dtc: wp.float64
    closing: wp.float64
    collisions: wp.float64
    impact_speed: wp.float64
    impact_step: wp.float64
    rest_step: wp.float64
    moved: wp.float64
    fault: wp.float64
    held: wp.float64
    gear: wp.float64
    shift_left: wp.float64
    rpm: wp.float64
    traction: wp.float64
    com: wp.vec3d
    orientation: wp.quatd
    velocity: wp.vec3d
    rate: wp.vec3d
    body_velocity: wp.vec3d
    specific_force: wp.vec3d
    rate_change: wp.vec3d
    steer: wp.vec2d
    wheel_angle: wp.vec4d
    wheel_speed: wp.vec4d
    suspension: wp.vec4d
    suspension_rate: wp.vec4d
    load: wp.vec4d
    slip: wp.vec4d
    sideslip: wp.vec4d
    pressure: wp.vec4d


WHEELS = ("fl", "fr", "rl", "rr")
"""Order of the wheels in every vector of four."""

_UNITS: dict[str, str] = {
    # Reference point: middle of the rear axle on the ground below the vehicle at rest.
    "x": "x_m",
    "y": "y_m",
    "yaw": "yaw_rad",
    "z": "z_m",
    "roll": "roll_rad",
    "pitch": "pitch_rad",
    # Forward speed and acceleration of the centre of mass, along the vehicle's x axis.
    "speed": "speed_mps",
    "accel": "accel_mps2",
    "yaw_rate": "yaw_rate_radps",
    # Positions of the actuators, after their lag: road-wheel angle (left positive) and 0..1.
    "steering": "steering_rad",
    "throttle": "throttle",
    "brake": "brake",
    "handbrake": "handbrake",
    # Distance to collider 0 and closing speed; the first collision; steps count physics steps
    # since reset, -1: never.
    "dtc": "dtc_m",
    "closing": "closing_mps",
    "collisions": "collisions",
    "impact_speed": "impact_speed_mps",
    "impact_step": "impact_step",
    "rest_step": "rest_step",
    "moved": "moved",
    # 0, or a code of twin.vehicle.guard; held: 1 while static friction keeps the vehicle at rest.
    "fault": "fault",
    "held": "held",
    # -1 reverse, 0 neutral, 1.. forward; seconds left of a shift; engine speed; the traction
    # control's share of torque.
    "gear": "gear",
    "shift_left": "shift_left_s",
    "rpm": "rpm",
    "traction": "traction",
    # Centre of mass in the world; world_from_vehicle as x, y, z, w; world velocity of the centre
    # of mass; angular velocity, velocity of the centre of mass, specific force there (what an
    # accelerometer reads: +g up at rest) and angular acceleration in vehicle axes.
    "com": "com_{xyz}_m",
    "orientation": "orientation_{xyzw}",
    "velocity": "velocity_{xyz}_mps",
    "rate": "rate_{xyz}_radps",
    "body_velocity": "body_velocity_{xyz}_mps",
    "specific_force": "specific_force_{xyz}_mps2",
    "rate_change": "rate_change_{xyz}_radps2",
    # Road-wheel angles after Ackermann; unwrapped wheel angles and speeds, forward positive.
    "steer": "steer_{lr}_rad",
    "wheel_angle": "wheel_angle_{wheel}_rad",
    "wheel_speed": "wheel_speed_{wheel}_radps",
    # Compression from the spring's free length, tyre load, slips and the ABS's share of pressure.
    "suspension": "suspension_{wheel}_m",
    "suspension_rate": "suspension_rate_{wheel}_mps",
    "load": "load_{wheel}_n",
    "slip": "slip_{wheel}",
    "sideslip": "sideslip_{wheel}",
    "pressure": "pressure_{wheel}",
}
_AXES: dict[str, tuple[str, ...]] = {
    "{xyz}": ("x", "y", "z"),
    "{xyzw}": ("x", "y", "z", "w"),
    "{lr}": ("left", "right"),
    "{wheel}": WHEELS,
}


def _columns() -> tuple[str, ...]:
    names: list[str] = []
    for field in VehicleState.vars:
        pattern = _UNITS[field]
        axes = next((axis for axis in _AXES if axis in pattern), "")
        names += [pattern.replace(axes, a) for a in _AXES[axes]] if axes else [pattern]
    return tuple(names)


TELEMETRY: tuple[str, ...] = _columns()
"""Names of the state's columns, in order, units last; x, y and yaw come first."""

COLUMN: dict[str, int] = {name: i for i, name in enumerate(TELEMETRY)}
"""Column of a state variable in the state array float64 [S, V, T]."""


def columns(field: str) -> slice:
    """Columns of a field of :class:`VehicleState`, e.g. ``columns("wheel_speed")`` for all four."""
    start = 0
    for name in VehicleState.vars:
        pattern = _UNITS[name]
        axes = next((axis for axis in _AXES if axis in pattern), "")
        width = len(_AXES[axes]) if axes else 1
        if name == field:
            return slice(start, start + width)
        start += width
    raise KeyError(field)
