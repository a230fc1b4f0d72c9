"""The road before the car, looked at from above: which pixel shows which place of a flat road.

Inverse perspective mapping (Bertozzi and Broggi 1998): the table is made once per camera by
projecting a grid of the road through mount and lens, so every lens that a vehicle file can describe
serves. What reaches a command is the whole number of a pixel, not the projection's last bits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import msgspec
import numpy as np

from devkit.perception import LUMA_WEIGHTS
from schemas.messages import CameraSite, Detection
from schemas.sections.lens_projection import project, vehicle_from_camera

STEP_M = 0.25
"""Distance of the grid's lines along the road [m]."""
PITCH_M = 0.04
"""Distance of its points across the road; a third of a marking's width [m]."""
HALF_WIDTH_M = 10.0
"""The grid reaches this far to either side [m]."""
AHEAD_MAX_M = 16.0
"""End of the view before the rear axle: a cubic does not follow a narrow bend any further [m]."""
ROW_MAX_M = 0.8
"""The view also ends where one row of the image covers more of the road than this [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class LaneView:
    """The grid of one camera: N lines across the road, M points each."""

    ahead_m: np.ndarray
    """float64 [N]: of each line, before the vehicle's reference point (rear axle) [m]."""
    pixel: np.ndarray
    """int32 [N, M]: which pixel of the flattened image shows a point, -1: none. The points of a
    line go from :data:`HALF_WIDTH_M` on the right to as much on the left."""
    width_px: int
    """Width of the image."""
    position_m: tuple[float, float, float]
    """Position of the camera: before the rear axle, left of the centre line, above the road [m]."""

    @classmethod
    def of_site(cls, site: CameraSite) -> LaneView:
        """The grid of a camera; empty (N = 0) if it sees no road ahead."""
        return _view(msgspec.msgpack.encode(site))

    def rolled(
        self, ahead_m: np.ndarray, left_m: np.ndarray, roll_rad: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Places of the grid while the car leans to its right by a small angle.

        In bends the image turns about the camera's axis, and the camera at height h and e to the
        left of the centre line moves down by e roll and aside by h roll. For one that looks ahead,
        what seems to be Y to its left and z ahead is f z ahead and f (Y + h roll) - h roll to the
        left, with f = (h + e roll) / (h - Y roll).
        """
        forward_m, lateral_m, above_m = self.position_m
        aside = left_m - lateral_m
        factor = (above_m + lateral_m * roll_rad) / (above_m - aside * roll_rad)
        shift_m = above_m * roll_rad
        return (
            forward_m + (ahead_m - forward_m) * factor,
            lateral_m + (aside + shift_m) * factor - shift_m,
        )

    def luma(
        self,
        image: np.ndarray,
        line: np.ndarray,
        point: np.ndarray,
        covered: Sequence[Detection] = (),
    ) -> np.ndarray:
        """Brightness of grid points, int32 of their shape, 256 units per level; -1: not seen.

        Args:
            image: uint8 [H, W, 3], RGB.
            line: indices of lines, of any shape that broadcasts with ``point``.
            point: indices of points; those beyond the grid are not seen.
            covered: objects that hide the road.
        """
        inside = (point >= 0) & (point < self.pixel.shape[1])
        pixel = np.where(inside, self.pixel[line, np.where(inside, point, 0)], -1)
        row, column = np.divmod(pixel, self.width_px)
        for box in covered:
            across = (column >= box.x_px) & (column <= box.x_px + box.width_px)
            hidden = across & (row >= box.y_px) & (row <= box.y_px + box.height_px)
            pixel = np.where(hidden, -1, pixel)
        colors = image.reshape(-1, 3)[pixel].astype(np.int32)
        red, green, blue = (w * colors[..., c] for c, w in enumerate(LUMA_WEIGHTS))
        return np.where(pixel >= 0, red + green + blue, -1)


def point_of(left_m: np.ndarray) -> np.ndarray:
    """Index of the grid point nearest to a place ``left_m`` to the left; it may be beyond it."""
    return np.rint((left_m + HALF_WIDTH_M) / PITCH_M).astype(np.int64)


def left_of(point: np.ndarray) -> np.ndarray:
    """Inverse of :func:`point_of` [m]."""
    return point * PITCH_M - HALF_WIDTH_M


@lru_cache(maxsize=64)
def _view(encoded: bytes) -> LaneView:
    site = msgspec.msgpack.decode(encoded, type=CameraSite)
    ahead = np.arange(1, math.floor(AHEAD_MAX_M / STEP_M) + 1) * STEP_M
    left = left_of(np.arange(round(2.0 * HALF_WIDTH_M / PITCH_M) + 1))
    px, visible = _project(site, ahead, left)
    column, row = (np.floor(np.nan_to_num(px[..., axis])).astype(np.int64) for axis in (0, 1))
    visible &= (column >= 0) & (column < site.width) & (row >= 0) & (row < site.height)
    pixel = np.where(visible, row * site.width + column, -1).astype(np.int32)
    # A line counts where its neighbour is not in the same row over and over.
    ends = np.stack([ahead, ahead + ROW_MAX_M])
    middle = _project(site, ends.ravel(), np.array([site.position_m[1]]))[0][:, 0, 1].reshape(2, -1)
    sharp = np.nan_to_num(middle[0] - middle[1]) >= 1.0
    kept = visible.any(axis=1) & sharp
    forward_m, lateral_m, above_m = site.position_m
    return LaneView(ahead[kept], pixel[kept], site.width, (forward_m, lateral_m, above_m))


def _project(
    site: CameraSite, ahead: np.ndarray, left: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels [N, M, 2] of road points, and which are visible [N, M]."""
    x, y = np.meshgrid(ahead, left, indexing="ij")
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    axes = vehicle_from_camera(site.rotation_deg)
    # Not a matrix product: whose order of summing would be the library's choice.
    offset = points - np.array(site.position_m)
    in_camera = (offset[:, :, None] * axes[None]).sum(axis=1)
    px, visible = project(site.lens, site.width, site.height, site.hfov_deg, in_camera)
    return px.reshape(*x.shape, 2), visible.reshape(x.shape)
