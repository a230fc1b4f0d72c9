"""Coordinate frames of ROS 2 (REP 103, 105, 147) and those of the simulator.

Both are right-handed with x forward, y left, z up; the vehicle's reference point (the middle of the
rear axle on the ground) is ``base_link``, the world is ``map``. Pictures belong to an optical frame
(z forward, x right, y down), whose name ends in ``_optical_frame`` or as a table says.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from schemas.steady import steady

Quaternion = tuple[float, float, float, float]
"""x, y, z, w."""

OPTICAL: Quaternion = (-0.5, 0.5, -0.5, 0.5)
"""Turns optical axes to those of the camera's body (x forward)."""

IDENTITY: Quaternion = (0.0, 0.0, 0.0, 1.0)

_BITS = 44
"""Sines end in other last bits on other hosts; what a stack gets does not."""


@dataclass(frozen=True, slots=True)
class StaticFrame:
    """A frame that stands still in its parent."""

    parent: str
    child: str
    position_m: tuple[float, float, float]
    rotation: Quaternion


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """The turn ``a`` after the turn ``b``."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def of_angles(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """A turn about z, of one about y, of one about x."""
    roll, pitch, yaw = (0.5 * angle for angle in (roll_rad, pitch_rad, yaw_rad))
    about_x = (math.sin(roll), 0.0, 0.0, math.cos(roll))
    about_y = (0.0, math.sin(pitch), 0.0, math.cos(pitch))
    about_z = (0.0, 0.0, math.sin(yaw), math.cos(yaw))
    x, y, z, w = steady(product(about_z, product(about_y, about_x)), _BITS).tolist()
    # No minus zero: the bytes of a message show it.
    return x + 0.0, y + 0.0, z + 0.0, w + 0.0


def of_mount(rotation_deg: Sequence[float]) -> Quaternion:
    """Turn of a mount: roll about x, pitch about y (down positive), yaw about z (left) [deg]."""
    roll, pitch, yaw = (math.radians(angle) for angle in rotation_deg)
    return of_angles(roll, pitch, yaw)


def yaw_of(rotation: Quaternion) -> float:
    """Heading of a turn, left of x [rad]."""
    x, y, z, w = rotation
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
