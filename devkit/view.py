"""The camera as the planner uses it: from pixels to places on a flat road."""

from __future__ import annotations

import math
from dataclasses import dataclass

from schemas.messages import CameraSite


@dataclass(frozen=True, slots=True)
class View:
    """A pinhole camera above a flat road; distortion of the lens is left out.

    Vehicle axes: x forward, y left, z up, from the middle of the rear axle on the ground.
    """

    width_px: int
    height_px: int
    focal_px: float
    forward_m: float
    """Camera before the rear axle [m]."""
    lateral_m: float
    """Camera left of the centre line [m]; right is negative."""
    above_m: float
    """Camera above the road [m]."""
    axes: tuple[tuple[float, float, float], ...] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    """Rotation from the camera's forward, left, up to vehicle axes, by rows."""

    @classmethod
    def of_site(cls, site: CameraSite) -> View:
        """The view of a camera with square pixels; ``site`` stands in the episode."""
        focal_px = 0.5 * site.width / math.tan(0.5 * math.radians(site.hfov_deg))
        forward_m, lateral_m, above_m = site.position_m
        axes = _rotation(*(math.radians(angle) for angle in site.rotation_deg))
        return cls(site.width, site.height, focal_px, forward_m, lateral_m, above_m, axes)

    def ray(self, x_px: float, y_px: float) -> tuple[float, float, float]:
        """Direction of a point of the image, vehicle axes; of no particular length."""
        left = (0.5 * self.width_px - x_px) / self.focal_px
        up = (0.5 * self.height_px - y_px) / self.focal_px
        x, y, z = (row[0] + row[1] * left + row[2] * up for row in self.axes)
        return x, y, z

    def ground_m(self, x_px: float, y_px: float) -> float | None:
        """How far ahead of the camera a point of the image lies on the road [m]; None if it lies
        on or above the horizon, or behind the camera."""
        x, _, z = self.ray(x_px, y_px)
        if z >= 0.0 or x <= 0.0:
            return None
        return x * self.above_m / -z

    def across_m(self, x_px: float, y_px: float, ahead_m: float) -> float:
        """Where the ray of a point of the image is ``ahead_m`` before the camera, seen from above:
        left of the centre line [m]."""
        x, y, _ = self.ray(x_px, y_px)
        return self.lateral_m + ahead_m * y / x


def _rotation(roll: float, pitch: float, yaw: float) -> tuple[tuple[float, float, float], ...]:
    """Roll about x, then pitch about y, then yaw about z, all about the vehicle's axes."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )
