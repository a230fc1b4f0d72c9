"""Lens models as tables of rays: one direction per pixel, whatever the model.

The camera frame is x right, y down, z forward. Image coordinates start in the upper left corner
and pixel centres lie at half numbers: OpenCV's coordinates plus 0.5.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from schemas.sections.lens import Lens
from schemas.sections.lens_curve import Intrinsics, check_lens, curve, intrinsics, radial
from schemas.sections.lens_projection import distorted, distortion

Floats = NDArray[np.float64]

_ITERATIONS_MAX = 30
_TOLERANCE = 1e-9
"""Largest residual of the inverted distortion, in focal lengths [-]."""


def ray_table(lens: Lens, width: int, height: int, hfov_deg: float) -> NDArray[np.float32]:
    """Unit directions through the pixel centres, float32 [H, W, 3]; zero: the lens sees nothing.

    Raises:
        ValueError: it does not fit the image (:func:`schemas.sections.lens_curve.check_lens`).
    """
    check_lens(lens, width, height, hfov_deg)
    inner = intrinsics(lens, width, height, hfov_deg)
    x = (np.arange(width) + 0.5 - inner.cx_px) / inner.fx_px
    y = (np.arange(height) + 0.5 - inner.cy_px) / inner.fy_px
    x, y = (a.copy() for a in np.broadcast_arrays(x[None, :], y[:, None]))
    rays = _fisheye_rays(lens, x, y) if lens.model == "fisheye" else _rays(lens, x, y)
    return rays.astype(np.float32)


def _rays(lens: Lens, x: Floats, y: Floats) -> Floats:
    """Directions of a perspective lens at image points in focal lengths."""
    seen = np.ones(x.shape, bool)
    if lens.model == "brown_conrady":
        x, y, seen = _undistorted(lens, x, y)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    rays[~seen] = 0.0
    return rays


def _undistorted(lens: Lens, xd: Floats, yd: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Invert Brown-Conrady: a start from the radial curve alone, then Newton's method in x and y.

    The matrix of derivatives is symmetric (the distortion is the gradient of a potential).
    """
    arguments, radii = curve(lens)
    rd = np.hypot(xd, yd)
    seen = rd <= radii[-1]
    start = np.interp(rd, radii, arguments) / np.where(rd > 0.0, rd, 1.0)
    x, y = xd * start, yd * start
    for _ in range(_ITERATIONS_MAX):
        off_x, off_y = (a - b for a, b in zip(distorted(lens, x, y), (xd, yd), strict=True))
        # Points that the lens does not see have no solution: they must not hold up the others.
        if max(np.abs(off_x[seen]).max(initial=0), np.abs(off_y[seen]).max(initial=0)) < _TOLERANCE:
            break
        a, b, c = _derivatives(lens, x, y)
        determinant = a * c - b * b
        x = x - (c * off_x - b * off_y) / determinant
        y = y - (a * off_y - b * off_x) / determinant
    wrong = np.maximum(np.abs(off_x), np.abs(off_y)) >= _TOLERANCE
    return x, y, seen & ~wrong


def _derivatives(lens: Lens, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """d xd/dx, d xd/dy = d yd/dx and d yd/dy of :func:`_distort`."""
    scale, scale_q = distortion(lens, x * x + y * y)
    return (
        scale + 2.0 * x * x * scale_q + 2.0 * lens.p1 * y + 6.0 * lens.p2 * x,
        2.0 * x * y * scale_q + 2.0 * lens.p1 * x + 2.0 * lens.p2 * y,
        scale + 2.0 * y * y * scale_q + 6.0 * lens.p1 * y + 2.0 * lens.p2 * x,
    )


def _fisheye_rays(lens: Lens, x: Floats, y: Floats) -> Floats:
    """Directions of a Kannala-Brandt lens at image points in focal lengths."""
    angles, radii = curve(lens)
    rd = np.hypot(x, y)
    seen = rd <= radii[-1]
    theta = np.interp(rd, radii, angles)
    for _ in range(_ITERATIONS_MAX):
        off = radial(lens, theta) - rd
        if np.abs(off[seen]).max(initial=0.0) < _TOLERANCE:
            break
        q = theta * theta
        slope = 7.0 * lens.k3 + q * 9.0 * lens.k4
        slope = 1.0 + q * (3.0 * lens.k1 + q * (5.0 * lens.k2 + q * slope))
        # Where the curve ends its slope may be 0; the start is as good as the answer there.
        theta = np.clip(theta - off / np.where(slope > 1e-6, slope, np.inf), 0.0, angles[-1])
    across = np.sin(theta) / np.where(rd > 0.0, rd, 1.0)
    rays = np.stack([x * across, y * across, np.cos(theta)], axis=-1)
    rays[~seen] = 0.0
    return rays


def projection_matrix(lens: Lens, width: int, height: int, hfov_deg: float) -> Floats:
    """The paper's P [4, 4] from near and far planes and left, right, top and bottom offsets.

    It takes view coordinates (x right, y up, z backward) to clip coordinates; after division by
    the last, the image spans -1 to 1 with y up.

    Raises:
        ValueError: the lens distorts, no matrix describes it.
    """
    if lens.model not in ("frustum", "pinhole"):
        raise ValueError(
            f"no projection matrix describes a {lens.model} lens; allowed: frustum, pinhole"
        )
    near, far = lens.near_m, lens.far_m
    left, right, top, bottom = _offsets(intrinsics(lens, width, height, hfov_deg), width, height)
    left, right, top, bottom = (near * offset for offset in (left, right, top, bottom))
    return np.array(
        [
            [2 * near / (right - left), 0, (right + left) / (right - left), 0],
            [0, 2 * near / (top - bottom), (top + bottom) / (top - bottom), 0],
            [0, 0, -(far + near) / (far - near), -2 * far * near / (far - near)],
            [0, 0, -1, 0],
        ]
    )


def _offsets(inner: Intrinsics, width: int, height: int) -> tuple[float, float, float, float]:
    """Left, right, top and bottom of the image at a distance of 1."""
    return (
        -inner.cx_px / inner.fx_px,
        (width - inner.cx_px) / inner.fx_px,
        inner.cy_px / inner.fy_px,
        (inner.cy_px - height) / inner.fy_px,
    )
