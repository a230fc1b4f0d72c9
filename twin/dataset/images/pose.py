"""Pose of the vehicle with the camera in an image."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class VehiclePose:
    """Pose of the ego: its rear axle on the ground, and how its body stands."""

    x_m: float
    y_m: float
    yaw_rad: float
    z_m: float
    """The body above where it usually is: a higher or lower mount."""
    pitch_rad: float
    """Positive looks down."""
    roll_rad: float


def quaternion(pose: VehiclePose) -> tuple[float, float, float, float]:
    """x, y, z, w of the rotation about x (roll), then y (pitch), then z (yaw)."""
    cr, sr = math.cos(pose.roll_rad / 2), math.sin(pose.roll_rad / 2)
    cp, sp = math.cos(pose.pitch_rad / 2), math.sin(pose.pitch_rad / 2)
    cy, sy = math.cos(pose.yaw_rad / 2), math.sin(pose.yaw_rad / 2)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def attitude(pose: VehiclePose) -> tuple[np.ndarray, np.ndarray]:
    """Position [3] and rotation [3, 3] of the vehicle in the world."""
    x, y, z, w = quaternion(pose)
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return np.array([pose.x_m, pose.y_m, pose.z_m]), rotation
