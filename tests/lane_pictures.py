"""Pictures of painted lanes on a bare road, straight from geometry: what a camera would see."""

from __future__ import annotations

import numpy as np

from schemas.messages import CameraSite
from schemas.sections.lens_curve import intrinsics
from schemas.sections.lens_projection import vehicle_from_camera
from twin.road.lane import LanePath

ASPHALT, PAINT, SKY = 80.0, 190.0, 150.0
EDGE_M, EDGE_WIDTH_M = -1.8, 0.1
MIDDLE_M, MIDDLE_WIDTH_M, DASH_M, PERIOD_M = 1.75, 0.14, 3.0, 7.5


class LanePainter:
    """Draws the markings of a lane as an ideal pinhole camera on a level car sees them."""

    def __init__(self, site: CameraSite, lane: LanePath, noise: float = 2.0, seed: int = 1) -> None:
        self._lane, self._noise = lane, noise
        self._shape = site.height, site.width
        self._random = np.random.default_rng(seed)
        inner = intrinsics(site.lens, site.width, site.height, site.hfov_deg)
        u = (np.arange(site.width) + 0.5 - inner.cx_px) / inner.fx_px
        v = (np.arange(site.height) + 0.5 - inner.cy_px) / inner.fy_px
        across, down = np.meshgrid(u, v)
        rays = np.stack([across, down, np.ones_like(across)], axis=-1)
        rays = rays @ vehicle_from_camera(site.rotation_deg).T
        above_m = site.position_m[2]
        with np.errstate(divide="ignore"):
            depth = np.where(rays[..., 2] < 0.0, -above_m / rays[..., 2], np.inf)
        self._road = (depth * rays[..., 0] > 0.0) & (depth * rays[..., 0] < 30.0)
        seen = depth[self._road]
        self._x = site.position_m[0] + seen * rays[self._road][:, 0]
        self._y = site.position_m[1] + seen * rays[self._road][:, 1]
        self._half_pixel_m = 0.5 * seen / inner.fx_px

    def picture(
        self, x_m: float, y_m: float, yaw_rad: float, *, painted: bool = True
    ) -> np.ndarray:
        """uint8 [H, W, 3] from a car whose rear axle is there."""
        luma = np.full(self._shape, SKY)
        ground = np.full(self._x.shape, ASPHALT)
        if painted:
            c, s = np.cos(yaw_rad), np.sin(yaw_rad)
            place = self._lane.locate(
                x_m + c * self._x - s * self._y, y_m + s * self._x + c * self._y
            )
            dash = place.s_m % PERIOD_M < DASH_M
            middle = self._stripe(place.lateral_m - MIDDLE_M, MIDDLE_WIDTH_M) * dash
            edge = self._stripe(place.lateral_m - EDGE_M, EDGE_WIDTH_M)
            ground += (PAINT - ASPHALT) * np.maximum(middle, edge)
        luma[self._road] = ground
        luma += self._noise * self._random.standard_normal(luma.shape)
        return np.repeat(np.clip(luma, 0, 255).astype(np.uint8)[..., None], 3, axis=-1)

    def _stripe(self, off_m: np.ndarray, width_m: float) -> np.ndarray:
        """Share of each pixel that a stripe covers."""
        half = self._half_pixel_m
        low = np.maximum(off_m - half, -width_m / 2)
        high = np.minimum(off_m + half, width_m / 2)
        return np.clip(high - low, 0.0, None) / (2.0 * half)
