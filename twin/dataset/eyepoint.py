"""Where a camera stands, and what that makes of points: rectangles, shares outside the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schemas.lens import CameraMount, Lens
from twin.render.lens import project, vehicle_from_camera

_QUARTERS = (
    (np.array([4.0, 1.0, 1.0]) / 6.0),
    (np.array([1.0, 4.0, 1.0]) / 6.0),
    (np.array([1.0, 1.0, 4.0]) / 6.0),
    (np.array([1.0, 1.0, 1.0]) / 3.0),
)
"""Centroids of the four parts of a triangle that its edges' middles cut, as weights of corners."""


@dataclass(frozen=True, slots=True)
class Eyepoint:
    """Place and attitude of a camera in the world."""

    eye_m: np.ndarray
    """float64 [3]"""
    world_from_camera: np.ndarray
    """float64 [3, 3]: its columns are the camera's right, down and ahead."""

    def camera_from_world(self, points_m: np.ndarray) -> np.ndarray:
        """World points [..., 3] in the camera's frame."""
        return (points_m - self.eye_m) @ self.world_from_camera


def eyepoint_of(
    position_m: np.ndarray, world_from_vehicle: np.ndarray, mount: CameraMount
) -> Eyepoint:
    """The camera of a vehicle at ``position_m`` [3] with the rotation [3, 3]."""
    eye = position_m + world_from_vehicle @ np.array(mount.position_m)
    return Eyepoint(eye, world_from_vehicle @ vehicle_from_camera(mount.rotation_deg))


def bounds_px(
    lens: Lens, width: int, height: int, hfov_deg: float, points: np.ndarray
) -> tuple[int, int, int, int]:
    """Pixels that may see something within ``points`` [N, 3] of the camera frame.

    Returns:
        Low x, low y, high x, high y; the high ones are not in it. All of the image where a point
        cannot be drawn.
    """
    px, _ = project(lens, width, height, hfov_deg, points)
    nearest = (
        np.linalg.norm(points, axis=1).min() if lens.model == "fisheye" else points[:, 2].min()
    )
    # Polynomials of lenses mean nothing outside what they draw, so a margin would be none.
    drawn = lens.model in ("pinhole", "frustum")
    if not np.isfinite(px).all() or nearest < 4.0 * lens.near_m:
        return 0, 0, width, height
    if not drawn:
        inside = ((px > -width) & (px < 2 * width)).all()
        front = points[:, 2].min() > 0.0
        if not (inside and front):
            return 0, 0, width, height
    low, high = np.floor(px.min(axis=0)) - 2, np.ceil(px.max(axis=0)) + 2
    x0, x1 = np.clip((low[0], high[0]), 0, width).astype(int)
    y0, y1 = np.clip((low[1], high[1]), 0, height).astype(int)
    return int(x0), int(y0), int(x1), int(y1)


def truncation(lens: Lens, width: int, height: int, hfov_deg: float, corners: np.ndarray) -> float:
    """Share of an object outside the image, of what it covers as seen from the camera.

    The measure is the solid angle of its triangles, summed without regard to what lies before what,
    so that it is the same for every lens and also right for what reaches behind the camera.

    Args:
        corners: of its triangles, in the camera's frame [F, 3, 3].
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = 0.5 * np.cross(b - a, c - a)
    inside = outside = 0.0
    for weights in _QUARTERS:
        centre = np.tensordot(weights, corners, axes=(0, 1))
        distance = np.maximum(np.linalg.norm(centre, axis=1), 0.2)
        angle = np.abs((normal * centre).sum(axis=1)) / distance**3
        _, seen = project(lens, width, height, hfov_deg, centre)
        inside += float(angle[seen].sum())
        outside += float(angle[~seen].sum())
    total = inside + outside
    return round(outside / total, 3) if total > 0.0 else 0.0
