"""What the car's own sensors measure, without errors: the contract between vehicle and sensors.

A vehicle model hands over one row per slot, on the device; whoever replaces the vehicle writes one
small adapter (see :mod:`twin.sensors.vehicle_truth`) and no sensor changes.
"""

from __future__ import annotations

import warp as wp

TRUTH = (
    # Reference point of the vehicle in the world [m].
    *("x_m", "y_m", "z_m"),
    # Rotation world_from_vehicle, a unit quaternion.
    *("qx", "qy", "qz", "qw"),
    # Specific force where the IMU sits, vehicle axes: acceleration minus gravity [m/s^2].
    *("force_x_mps2", "force_y_mps2", "force_z_mps2"),
    # Angular rate, vehicle axes [rad/s].
    *("rate_x_radps", "rate_y_radps", "rate_z_radps"),
    # Angles the wheels have turned since reset, forward positive, never wrapped [rad].
    *("wheel_fl_rad", "wheel_fr_rad", "wheel_rl_rad", "wheel_rr_rad"),
)
"""Columns of the truth, float64 [S, T]; vehicle axes x forward, y left, z up."""

POSITION = wp.constant(TRUTH.index("x_m"))
ROTATION = wp.constant(TRUTH.index("qx"))
FORCE = wp.constant(TRUTH.index("force_x_mps2"))
RATE = wp.constant(TRUTH.index("rate_x_radps"))
WHEELS = wp.constant(TRUTH.index("wheel_fl_rad"))


@wp.func
def vector_at(truth: wp.array2d(dtype=wp.float64), slot: wp.int32, column: wp.int32) -> wp.vec3d:
    """Three columns of a row."""
    return wp.vec3d(truth[slot, column], truth[slot, column + 1], truth[slot, column + 2])


@wp.func
def rotation_at(truth: wp.array2d(dtype=wp.float64), slot: wp.int32) -> wp.quatd:
    """world_from_vehicle of a slot."""
    return wp.quatd(
        truth[slot, ROTATION],
        truth[slot, ROTATION + 1],
        truth[slot, ROTATION + 2],
        truth[slot, ROTATION + 3],
    )
