"""Columns of a vehicle's state, for those who only look at numbers: no Warp is loaded.

The state itself is :class:`twin.vehicle.state.VehicleState`, whose fields are these in this order.
"""

from __future__ import annotations

import functools

PHYSICS_STEP_NS = 2_000_000
"""Physics step [ns]."""

WHEELS = ("fl", "fr", "rl", "rr")
"""Order of the wheels in every vector of four."""

UNITS: dict[str, str] = {
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
    # Distance to the scenario's target and closing speed; the first collision; steps count physics
    # steps since reset, -1: never.
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
"""Name of a field of the state -> name of its column, or the pattern of its columns' names."""
_AXES: dict[str, tuple[str, ...]] = {
    "{xyz}": ("x", "y", "z"),
    "{xyzw}": ("x", "y", "z", "w"),
    "{lr}": ("left", "right"),
    "{wheel}": WHEELS,
}


def _columns() -> tuple[str, ...]:
    names: list[str] = []
    for pattern in UNITS.values():
        axes = next((axis for axis in _AXES if axis in pattern), "")
        names += [pattern.replace(axes, a) for a in _AXES[axes]] if axes else [pattern]
    return tuple(names)


TELEMETRY: tuple[str, ...] = _columns()
"""Names of the state's columns, in order, units last; x, y and yaw come first."""

COLUMN: dict[str, int] = {name: i for i, name in enumerate(TELEMETRY)}
"""Column of a state variable in the state array float64 [S, V, T]."""


@functools.cache
def columns(field: str) -> slice:
    """Columns of a field of the state, e.g. ``columns("wheel_speed")`` for all four."""
    start = 0
    for name, pattern in UNITS.items():
        axes = next((axis for axis in _AXES if axis in pattern), "")
        width = len(_AXES[axes]) if axes else 1
        if name == field:
            return slice(start, start + width)
        start += width
    raise KeyError(field)
