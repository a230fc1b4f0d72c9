"""Where a camera draws what stands before it: projection through any lens, and its mount.

The camera frame is x right, y down, z forward. Image coordinates start in the upper left corner
and pixel centres lie at half numbers: OpenCV's coordinates plus 0.5.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from schemas.sections.lens import Lens
from schemas.sections.lens_curve import curve, intrinsics, radial

Floats = NDArray[np.float64]


def project(
    lens: Lens, width: int, height: int, hfov_deg: float, points: NDArray[np.floating]
) -> tuple[Floats, NDArray[np.bool_]]:
    """Where points [N, 3] of the camera frame [m] are drawn: px [N, 2], and which are visible [N].

    Visible: inside the image and what the lens draws, between its near and far planes (of a
    fisheye lens: spheres). Invisible points behind a perspective camera have NaN for coordinates.
    """
    inner = intrinsics(lens, width, height, hfov_deg)
    x, y, z = np.asarray(points, np.float64).reshape(-1, 3).T
    arguments, _ = curve(lens)
    if lens.model == "fisheye":
        across = np.hypot(x, y)
        argument = np.arctan2(across, z)
        factor = radial(lens, argument) / np.where(across > 0.0, across, 1.0)
        xd, yd = x * factor, y * factor
        depth = np.hypot(across, z)
    else:
        depth = z
        front = np.where(z > 0.0, z, np.nan)
        xd, yd = x / front, y / front
        argument = np.hypot(xd, yd)
        if lens.model == "brown_conrady":
            xd, yd = distorted(lens, xd, yd)
    px = np.stack([inner.fx_px * xd + inner.cx_px, inner.fy_px * yd + inner.cy_px], axis=-1)
    with np.errstate(invalid="ignore"):
        visible = (depth >= lens.near_m) & (depth <= lens.far_m) & (argument <= arguments[-1])
        visible &= ((px >= 0.0) & (px <= (width, height))).all(axis=-1)
    return px, visible


def vehicle_from_camera(rotation_deg: list[float]) -> Floats:
    """Rotation matrix [3, 3] of a mount: its columns are the camera's right, down and forward.

    ``rotation_deg`` is :attr:`schemas.sections.lens.CameraMount.rotation_deg`; without rotation the
    camera looks along the vehicle's x.
    """
    roll, pitch, yaw = (math.radians(angle) for angle in rotation_deg)
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    level = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    matrix: Floats = about_z @ about_y @ about_x @ level
    return matrix


def distorted(lens: Lens, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Brown-Conrady: where the point (x, y, 1) is drawn, in focal lengths."""
    q = x * x + y * y
    scale = distortion(lens, q)[0]
    return (
        x * scale + 2.0 * lens.p1 * x * y + lens.p2 * (q + 2.0 * x * x),
        y * scale + lens.p1 * (q + 2.0 * y * y) + 2.0 * lens.p2 * x * y,
    )


def distortion(lens: Lens, q: Floats) -> tuple[Floats, Floats]:
    """Radial factor and its derivative, over the squared radius ``q``."""
    above = 1.0 + q * (lens.k1 + q * (lens.k2 + q * lens.k3))
    below = 1.0 + q * (lens.k4 + q * (lens.k5 + q * lens.k6))
    above_q = lens.k1 + q * (2.0 * lens.k2 + q * 3.0 * lens.k3)
    below_q = lens.k4 + q * (2.0 * lens.k5 + q * 3.0 * lens.k6)
    return above / below, (above_q * below - above * below_q) / (below * below)
