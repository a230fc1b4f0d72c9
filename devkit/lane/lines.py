"""Lane markings in one camera image: bright ridges of their width, near where they should be.

On the road seen from above a marking is a stripe brighter than what lies on both sides of it (top
hat; Bertozzi and Broggi 1998). Edges of shadows, kerbs and cars have one bright side only, so they
do not count. All sums are whole numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from devkit.lane.curve import LaneCurve
from devkit.lane.view import PITCH_M, LaneView, left_of, point_of
from schemas.messages import Detection

CORE = 1
"""Half the width of the stripe that is summed up: three points, 0.12 m [points]."""
FLANK = 5
"""Distance from the middle of a stripe to the middle of either flank: 0.20 m [points]."""
LEVELS_MIN = 3.0
"""Least brightness above the flanks [image levels of 255]."""
CONTRAST_MIN = 0.06
"""Least brightness above the flanks, relative to the stripe's own: texture of asphalt and of wide
painted areas stays below, a marking in heavy fog above [-]."""
NOISE_FACTOR = 3.0
"""Least brightness above the flanks, relative to the median of everything looked at [-]."""

_REACH = FLANK + CORE
_SUMMED = 2 * CORE + 1
_LUMA_PER_LEVEL = 256


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Places [P] on lane markings, in the vehicle's axes."""

    ahead_m: np.ndarray
    """Distances before the rear axle [m]."""
    left_m: np.ndarray
    """Left of the vehicle's centre line [m]."""
    line_m: np.ndarray
    """Place of the marking that this is taken for, left of the lane's centre [m]."""


def find_points(
    image: np.ndarray,
    view: LaneView,
    curve: LaneCurve,
    lines_m: tuple[float, ...],
    gate_m: float,
    covered: Sequence[Detection] = (),
) -> Points:
    """The brightest ridge per line of the grid and marking, within a gate around the expectation.

    Args:
        image: uint8 [H, W, 3], RGB.
        view: the camera's grid.
        curve: where the lane's centre is expected.
        lines_m: where markings are painted, left of the lane's centre [m].
        gate_m: how far from its expected place a marking is looked for [m].
        covered: objects in the image; their outlines are no markings.
    """
    count = len(view.ahead_m)
    if not count:
        return Points(*(np.zeros(0) for _ in range(3)))
    stretch = curve.stretch(view.ahead_m)
    expected = curve.left_m(view.ahead_m) + np.array(lines_m)[:, None] * stretch
    half = round(gate_m / PITCH_M) + _REACH
    points = point_of(expected)[..., None] + np.arange(-half, half + 1)
    luma = view.luma(image, np.arange(count)[:, None], points, covered)
    ridge, stripe, visible = _ridge(luma)
    best = np.argmax(np.where(visible, ridge, -1), axis=-1)[..., None]
    height = np.take_along_axis(ridge, best, -1)[..., 0]
    is_line = np.take_along_axis(visible, best, -1)[..., 0]
    brightness = np.take_along_axis(stripe, best, -1)[..., 0]
    is_line &= (height >= _threshold(ridge[visible])) & (height >= CONTRAST_MIN * brightness)
    line, row = np.nonzero(is_line)
    at = np.take_along_axis(points, best + _REACH, -1)[..., 0]
    return Points(view.ahead_m[row], left_of(at[line, row]), np.array(lines_m)[line])


def _ridge(luma: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Brightness of stripes above the brighter of their flanks [K, N, W - 2 _REACH], in luma summed
    over the stripe, their own brightness, and where all of it was seen."""
    width = luma.shape[-1]
    stripe = sum(luma[..., i : width - 2 * CORE + i] for i in range(_SUMMED))
    size = width - 2 * _REACH
    middle = stripe[..., FLANK : FLANK + size]
    flanks = np.maximum(stripe[..., :size], stripe[..., 2 * FLANK : 2 * FLANK + size])
    # What a lens draws of a line of the road is one piece, so its ends tell.
    visible = (luma[..., :size] >= 0) & (luma[..., 2 * _REACH :] >= 0)
    return middle - flanks, middle, visible


def _threshold(ridge: np.ndarray) -> float:
    least = LEVELS_MIN * _LUMA_PER_LEVEL * _SUMMED
    if not ridge.size:
        return least
    size = np.abs(ridge)
    return max(least, NOISE_FACTOR * float(np.partition(size, size.size // 2)[size.size // 2]))
