"""The camera as the planner uses it: from pixels to places on a flat road."""

from __future__ import annotations

import math
from dataclasses import dataclass

from schemas.messages import CameraSite
from schemas.sections.lens_curve import Intrinsics, intrinsics
from schemas.sections.lens_projection import vehicle_from_camera

Axis = tuple[float, float, float]
Axes = tuple[Axis, Axis, Axis]


@dataclass(frozen=True, slots=True)
class CameraView:
    """A camera above a flat road, by the pinhole of its lens; distortion is left out: boxes of
    detectors are no more exact. :mod:`devkit.lane.view` projects markings with all of it.

    Vehicle axes: x forward, y left, z up, from the middle of the rear axle on the ground.
    """

    width_px: int
    height_px: int
    lens: Intrinsics
    forward_m: float
    """Camera before the rear axle [m]."""
    lateral_m: float
    """Camera left of the centre line [m]; right is negative."""
    above_m: float
    """Camera above the road [m]."""
    axes: Axes = ((0, -1, 0), (0, 0, -1), (1, 0, 0))
    """The camera's right, down and forward in vehicle axes."""

    @classmethod
    def of_site(cls, site: CameraSite) -> CameraView:
        """The view of a camera; ``site`` stands in the episode."""
        lens = intrinsics(site.lens, site.width, site.height, site.hfov_deg)
        right, down, forward = vehicle_from_camera(site.rotation_deg).T.tolist()
        axes = (tuple(right), tuple(down), tuple(forward))
        return cls(site.width, site.height, lens, *site.position_m, axes)

    def ray(self, x_px: float, y_px: float) -> tuple[float, float, float]:
        """Direction of a point of the image, vehicle axes; of no particular length."""
        right = (x_px - self.lens.cx_px) / self.lens.fx_px
        down = (y_px - self.lens.cy_px) / self.lens.fy_px
        x, y, z = (f + r * right + d * down for r, d, f in zip(*self.axes, strict=True))
        return x, y, z

    def ground_m(self, x_px: float, y_px: float) -> float | None:
        """Distance ahead of the camera of a point of the image on the road [m]; None if it lies
        on or above the horizon, or behind the camera."""
        x, _, z = self.ray(x_px, y_px)
        if z >= 0.0 or x <= 0.0:
            return None
        return x * self.above_m / -z

    def across_m(self, x_px: float, y_px: float, ahead_m: float) -> float:
        """Place of an image point's ray ``ahead_m`` before the camera, seen from above:
        left of the centre line [m]; infinite of a ray to the side or to the back."""
        x, y, _ = self.ray(x_px, y_px)
        if x <= 0.0:
            return math.copysign(math.inf, y)
        return self.lateral_m + ahead_m * y / x
