"""A pose that a stack commands in co-simulation."""

from __future__ import annotations

import math

from msgspec import Struct


class Pose(Struct, frozen=True):
    """Where the ego's reference point is to be: the middle of the rear axle on the ground; the
    rotation takes vehicle axes (x forward, y left, z up) to world axes."""

    x_m: float
    y_m: float
    z_m: float
    qx: float
    qy: float
    qz: float
    qw: float


POSE_LIMIT_M = 1e5
"""Largest coordinate of a :class:`Pose` [m]."""

POSE_NORM_TOLERANCE = 0.01
"""How far a quaternion's length may be from 1: some print few digits. It is made 1."""


def pose_mistake(pose: Pose) -> str:
    """What is wrong with it, or an empty string."""
    for name in ("x_m", "y_m", "z_m"):
        value = getattr(pose, name)
        if not abs(value) <= POSE_LIMIT_M:
            return f"command pose.{name} is {value}, allowed: +-{POSE_LIMIT_M:g}"
    norm = math.hypot(pose.qx, pose.qy, pose.qz, pose.qw)
    if not abs(norm - 1.0) <= POSE_NORM_TOLERANCE:
        return f"command pose: the quaternion's length is {norm:g}, allowed: 1"
    return ""
