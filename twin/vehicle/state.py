"""State of a vehicle: one Warp struct, and the same memory as columns of float64.

Kernels read and write :class:`VehicleState` by name; the host sees ``float64 [S, V, T]``, slot
first, and finds a value by :data:`COLUMN`. Wheels come front left, front right, rear left, rear
right. World and vehicle axes: x forward (along the street), y left, z up.
"""

from __future__ import annotations

import warp as wp

from twin.vehicle.columns import COLUMN, TELEMETRY, UNITS, WHEELS, columns

__all__ = ["COLUMN", "TELEMETRY", "WHEELS", "VehicleState", "columns"]


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


assert tuple(VehicleState.vars) == tuple(UNITS), "fields and columns differ"
