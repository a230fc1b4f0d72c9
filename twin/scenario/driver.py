"""Who drives the ego of a case: the stack, or a robot until the stack intervenes; no Warp."""

from __future__ import annotations

import math
from typing import NamedTuple

from schemas.messages import Pose

BRAKED, STEERED = 1, 2
"""How a stack intervenes, as KPIs have it."""


class RobotLimits(NamedTuple):
    """From which commands on a robot lets go."""

    brake: float
    """Brake or handbrake, above 0 to 1 [-]."""
    steering_rad: float
    """Angle of the road wheels outside of what lies between straight ahead and the robot's path
    [rad]."""

    def exceeded(
        self, brake: float, handbrake: float, steering_rad: float, path_rad: float | None
    ) -> int:
        """How commands in force intervene, :data:`BRAKED` or :data:`STEERED`; 0: they do not.

        A stack that steers as the path goes does not intervene, nor one that holds the wheel
        straight while the robot turns off, nor one in between.

        Args:
            brake: pedal [-].
            handbrake: lever [-].
            steering_rad: angle of the road wheels [rad].
            path_rad: angle that the robot's path takes [rad]; None: steering is not looked at.
        """
        if max(brake, handbrake) >= self.brake:
            return BRAKED
        if path_rad is not None:
            beyond_rad = max(steering_rad - max(path_rad, 0.0), min(path_rad, 0.0) - steering_rad)
            if beyond_rad >= self.steering_rad:
                return STEERED
        return 0


class LedPose(NamedTuple):
    """Where a robot has its ego."""

    x_m: float
    """World [m]; of the reference point."""
    y_m: float
    z_m: float
    yaw_rad: float
    pitch_rad: float
    """Nose down positive."""
    roll_rad: float
    speed_mps: float

    @property
    def pose(self) -> Pose:
        """As a command has it: turned about z by the yaw, about y by the pitch, about x by the
        roll."""
        (sz, cz), (sy, cy), (sx, cx) = (
            (math.sin(angle / 2), math.cos(angle / 2))
            for angle in (self.yaw_rad, self.pitch_rad, self.roll_rad)
        )
        return Pose(
            x_m=self.x_m,
            y_m=self.y_m,
            z_m=self.z_m,
            qx=cz * cy * sx - sz * sy * cx,
            qy=cz * sy * cx + sz * cy * sx,
            qz=sz * cy * cx - cz * sy * sx,
            qw=cz * cy * cx + sz * sy * sx,
        )
