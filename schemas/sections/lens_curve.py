"""How far from the axis a lens draws what it sees: focal lengths, radial curve, and its limits."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schemas.sections.lens import Lens

Floats = NDArray[np.float64]

_STEPS = 8192
_PERSPECTIVE_MAX_DEG = 89.5
"""Largest angle off the axis of the models whose curve is over the tangent."""


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """Pinhole part of a lens, in pixels of one image; pixel centres lie at half numbers."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float


@dataclass(frozen=True, slots=True)
class Reach:
    """Point up to which the radial curve rises: beyond it the lens sees nothing, or sees it
    twice."""

    argument: float
    """Largest tan(theta) (perspective models) or theta [rad] (fisheye)."""
    radius: float
    """Image radius there over the focal length [-]."""

    def angle_deg(self, lens: Lens) -> float:
        """The angle off the axis [deg]."""
        angle = self.argument if lens.model == "fisheye" else math.atan(self.argument)
        return math.degrees(angle)


def radial(lens: Lens, x: Floats) -> Floats:
    """Image radius over the focal length, for tan(theta) or, of a fisheye lens, for theta [rad]."""
    q = x * x
    if lens.model == "fisheye":
        return x * (1.0 + q * (lens.k1 + q * (lens.k2 + q * (lens.k3 + q * lens.k4))))
    if lens.model == "brown_conrady":
        above = 1.0 + q * (lens.k1 + q * (lens.k2 + q * lens.k3))
        below = 1.0 + q * (lens.k4 + q * (lens.k5 + q * lens.k6))
        return x * above / np.where(below > 0.0, below, np.nan)
    return x


@functools.lru_cache(maxsize=64)
def curve(lens: Lens) -> tuple[Floats, Floats]:
    """Arguments and radii of the rising part of the radial curve, from 0 on, for look-ups.

    Read only: asked for with every projection of points.
    """
    if lens.model == "fisheye":
        x = np.linspace(0.0, math.radians(lens.circle_deg) / 2.0, _STEPS)
    else:
        x = np.tan(np.linspace(0.0, math.radians(_PERSPECTIVE_MAX_DEG), _STEPS))
    y = radial(lens, x)
    rising = np.diff(y) > 0.0  # false beside a NaN, too
    end = len(x) if rising.all() else int(np.argmin(rising)) + 1
    x.flags.writeable = y.flags.writeable = False
    return x[:end], y[:end]


def reach(lens: Lens) -> Reach:
    """Where the lens ends."""
    x, y = curve(lens)
    return Reach(float(x[-1]), float(y[-1]))


def intrinsics(lens: Lens, width: int, height: int, hfov_deg: float) -> Intrinsics:
    """Focal lengths and principal point for an image of ``width`` x ``height`` [px].

    A frustum with planes N and L, R, T, B is the pinhole with fx = W N / (R - L) and
    cx = -W L / (R - L), likewise for y.

    Raises:
        ValueError: the lens cannot have this field of view.
    """
    if lens.model == "frustum" and lens.right_m > lens.left_m:
        across, down = lens.right_m - lens.left_m, lens.top_m - lens.bottom_m
        return Intrinsics(
            width * lens.near_m / across,
            height * lens.near_m / down,
            -width * lens.left_m / across,
            height * lens.top_m / down,
        )
    fx_px = lens.fx * width if lens.fx > 0.0 else _focal_px(lens, width, hfov_deg)
    fy_px = lens.fy * height if lens.fy > 0.0 else fx_px
    return Intrinsics(fx_px, fy_px, lens.cx * width, lens.cy * height)


def _focal_px(lens: Lens, width: int, hfov_deg: float) -> float:
    half = math.radians(hfov_deg) / 2.0
    end = reach(lens)
    limit_deg = 2.0 * end.angle_deg(lens)
    if not 0.0 < hfov_deg <= limit_deg:
        raise ValueError(
            f"hfov_deg {hfov_deg:g} with a {lens.model} lens: its image ends at "
            f"{limit_deg:.1f} deg across; lower hfov_deg, or change its coefficients"
        )
    x = half if lens.model == "fisheye" else math.tan(half)
    return 0.5 * width / float(radial(lens, np.array([x]))[0])


def check_lens(lens: Lens, width: int, height: int, hfov_deg: float) -> None:
    """Whether the lens draws one picture on the whole image.

    A Brown-Conrady polynomial that turns back inside the image would show a ring twice. A fisheye
    image may leave the corners black, as long as it spans the width.

    Raises:
        ValueError: it does not; one line says where.
    """
    inner = intrinsics(lens, width, height, hfov_deg)
    if lens.model not in ("brown_conrady", "fisheye"):
        return
    end = reach(lens)
    right = max(inner.cx_px, width - inner.cx_px) / inner.fx_px
    down = max(inner.cy_px, height - inner.cy_px) / inner.fy_px
    if lens.model == "fisheye":
        full = end.argument >= math.radians(lens.circle_deg) / 2.0 - 1e-9
        needed, where = (0.0 if full else 0.5 * width / inner.fx_px), "edge"
    else:
        needed, where = math.hypot(right, down), "corner"
    if end.radius < needed:
        names = ("k1", "k2", "k3", "k4", "k5", "k6")
        terms = ", ".join(f"{n} {getattr(lens, n):g}" for n in names if getattr(lens, n) != 0.0)
        raise ValueError(
            f"{lens.model} lens with {terms}: its curve turns back {end.angle_deg(lens):.1f} deg "
            f"off the axis at {end.radius:.3g} focal lengths, and the image's {where} is at "
            f"{needed:.3g}; narrow the field of view or change the coefficients"
        )
