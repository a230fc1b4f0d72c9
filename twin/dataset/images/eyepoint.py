"""Place of a camera, and what that makes of points: rectangles, shares outside the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schemas.sections.lens import CameraMount, Lens
from schemas.sections.lens_projection import project, vehicle_from_camera

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
        return rotated(points_m - self.eye_m, self.world_from_camera.T)


def rotated(points: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """``turn`` [3, 3] times each of ``points`` [N, 3]: the same bits for any N and any number of
    threads, unlike a matrix product."""
    x, y, z = points.T
    return np.stack([row[0] * x + row[1] * y + row[2] * z for row in turn], axis=1)


def eyepoint_of(
    position_m: np.ndarray, world_from_vehicle: np.ndarray, mount: CameraMount
) -> Eyepoint:
    """The camera of a vehicle at ``position_m`` [3] with the rotation [3, 3]."""
    eye = position_m + world_from_vehicle @ np.array(mount.position_m)
    return Eyepoint(eye, world_from_vehicle @ vehicle_from_camera(mount.rotation_deg))


@dataclass(frozen=True, slots=True)
class EyeView:
    """Projection of one camera: its lens and the size of its image."""

    lens: Lens
    width: int
    height: int
    hfov_deg: float

    def drawn(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Image coordinates [N, 2] of ``points`` [N, 3] of the camera frame, and which are seen."""
        return project(self.lens, self.width, self.height, self.hfov_deg, points)


@dataclass(frozen=True, slots=True)
class Outline:
    """Outline of an object in an image."""

    bounds_px: tuple[int, int, int, int]
    """Low x, low y, high x, high y of the pixels that may see it; the high ones are not in it. All
    of the image where a part of it cannot be drawn."""
    truncation: float
    """Share of it outside the image; see :func:`outlines_of`."""
    nearest_m: float
    """Distance from the camera to its nearest corner [m]."""


Shape = tuple[np.ndarray, np.ndarray]
"""Points [V, 3] and the triangles between them [F, 3], as indices."""


def outlines_of(view: EyeView, shapes: list[Shape]) -> list[Outline]:
    """Outlines of objects in the image; their points are in the camera frame.

    Truncation is the share outside the image of what an object covers as seen from the camera: the
    solid angle of its triangles, summed without regard to what lies before what. So it is the same
    for every lens, and right for what reaches behind the camera.
    """
    if not shapes:
        return []
    points = np.concatenate([points for points, _ in shapes])
    px, seen = view.drawn(points)
    away = np.linalg.norm(points, axis=1)
    edges = np.cumsum([0, *(len(points) for points, _ in shapes)]).tolist()
    found = []
    for (own, faces), first, end in zip(shapes, edges[:-1], edges[1:], strict=True):
        part = slice(first, end)
        nearest_m = float(away[part].min())
        if seen[part].all():
            found.append(Outline(_around(view, px[part]), 0.0, nearest_m))
            continue
        bounds = (0, 0, view.width, view.height)
        # Polynomials of lenses mean nothing outside what they draw.
        good = view.lens.model in ("pinhole", "frustum") and np.isfinite(px[part]).all()
        if good and own[:, 2].min() > view.lens.near_m:
            bounds = _around(view, px[part])
        found.append(Outline(bounds, _truncation(view, own[faces]), nearest_m))
    return found


def _around(view: EyeView, px: np.ndarray) -> tuple[int, int, int, int]:
    """Straight edges of triangles are bent by a lens, less than the two pixels left for it."""
    low, high = np.floor(px.min(axis=0)) - 2, np.ceil(px.max(axis=0)) + 2
    x0, x1 = np.clip((low[0], high[0]), 0, view.width).astype(int).tolist()
    y0, y1 = np.clip((low[1], high[1]), 0, view.height).astype(int).tolist()
    return x0, y0, x1, y1


def _truncation(view: EyeView, corners: np.ndarray) -> float:
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = 0.5 * np.cross(b - a, c - a)
    centres = np.stack([np.tensordot(w, corners, axes=(0, 1)) for w in _QUARTERS])  # [4, F, 3]
    distance = np.maximum(np.linalg.norm(centres, axis=2), 0.2)
    angle = np.abs((normal * centres).sum(axis=2)) / distance**3
    _, seen = view.drawn(centres.reshape(-1, 3))
    total = float(angle.sum())
    outside = float(angle[~seen.reshape(angle.shape)].sum())
    return round(outside / total, 3) if total > 0.0 else 0.0
