"""Depth of field: a thin lens draws what is out of focus as a disc.

The disc's diameter on the sensor is A f / (s - f) |d - s| / d, with the focal length f, the
aperture A = f / N, the focus s and the distance d (Potmesil and Chakravarty 1981); as a function
of 1/d it is a straight line. A pixel gathers over the largest disc that may reach it; what is
nearer spreads over it with its own disc, what is farther with the pixel's, so that sharp objects
do not leak into the blurred background.
"""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from schemas.sections.lens import Lens
from schemas.sections.lens_curve import intrinsics
from twin.render.light.light import SlotLight
from twin.render.post.pixels import load, store

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TAPS = 24
"""Samples of a disc."""
_TAPS = wp.constant(TAPS)
_TURNS = 4
_SHARP_PX = wp.constant(0.5)
"""Discs of a smaller radius are a pixel."""


@wp.struct
class ThinLens:
    """The thin lens, in pixels of one image."""

    strength: wp.float32
    """Radius of the disc over the difference of the inverse distances [px m]."""
    inverse_m: wp.float32
    """One over the distance in focus [1/m]."""
    radius_max: wp.float32
    """Largest radius that is drawn [px]; also the side of a tile."""
    tile: wp.int32
    """Side of a tile [px]."""


def tile_px(height: int) -> int:
    """Side of a tile and largest radius of a disc: between 1/45 and 1/22 of the height [px]."""
    return max(4, 1 << round(math.log2(max(height, 64) / 31.0)))


def focus_of(lens: Lens, height: int, width: int, hfov_deg: float) -> ThinLens:
    """The lens's focus for an image.

    Raises:
        ValueError: it is focused within its own focal length.
    """
    focal_m = intrinsics(lens, width, height, hfov_deg).fx_px / width * lens.sensor_width_mm * 1e-3
    if lens.focus_m <= focal_m:
        raise ValueError(
            f"focus_m {lens.focus_m:g} with a focal length of {focal_m:.3g} m: "
            "focus_m must be larger; raise it or lower sensor_width_mm"
        )
    aperture_m = focal_m / lens.f_number
    focus = ThinLens()
    sensor_m = aperture_m * focal_m * lens.focus_m / (lens.focus_m - focal_m)
    focus.strength = 0.5 * sensor_m / (lens.sensor_width_mm * 1e-3) * width
    focus.inverse_m = 1.0 / lens.focus_m
    focus.tile = tile_px(height)
    focus.radius_max = float(focus.tile)
    return focus


def taps() -> np.ndarray:
    """x, y and distance of the samples, float32 [TAPS, 3], of equal area on the unit disc: a
    sunflower (Vogel 1979)."""
    i = np.arange(TAPS)
    radius = np.sqrt((i + 0.5) / TAPS)
    angle = i * math.pi * (3.0 - math.sqrt(5.0))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), radius], -1).astype(np.float32)


def turns() -> np.ndarray:
    """Cosine and sine by which the samples of the pixels of a 4x4 block are turned, float32
    [16, 2]: ordered as Bayer's matrix, so neighbours differ most."""
    bayer = np.array([0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5])
    angle = 2.0 * math.pi * bayer / 16.0
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1).astype(np.float32)


@wp.func
def _distance(depth_m: wp.float32) -> wp.float32:
    """Depth, or very far where there is none [m]."""
    far = wp.float32(1.0e30)
    if depth_m > 0.0:
        far = wp.min(depth_m, far)
    return far


@wp.func
def _disc(focus: ThinLens, depth_m: wp.float32) -> wp.float32:
    """Radius of the disc [px]."""
    return wp.min(
        focus.strength * wp.abs(focus.inverse_m - 1.0 / wp.max(depth_m, 1.0e-3)), focus.radius_max
    )


@wp.kernel
def near_tiles_kernel(
    focus: ThinLens,
    lights: wp.array(dtype=SlotLight),
    depth: wp.array3d(dtype=wp.float32),
    tiles_out: wp.array3d(dtype=wp.float32),
):
    """Largest disc before the focus in every tile [px]."""
    slot, tile_row, tile_column = wp.tid()
    if lights[slot].active == 0:
        return
    nearest = wp.float32(1.0e30)
    for i in range(focus.tile):
        row = wp.min(tile_row * focus.tile + i, depth.shape[1] - 1)
        for j in range(focus.tile):
            column = wp.min(tile_column * focus.tile + j, depth.shape[2] - 1)
            nearest = wp.min(nearest, _distance(depth[slot, row, column]))
    radius = wp.float32(0.0)
    if nearest * focus.inverse_m < 1.0:
        radius = _disc(focus, nearest)
    tiles_out[slot, tile_row, tile_column] = radius


@wp.kernel
def widen_tiles_kernel(
    lights: wp.array(dtype=SlotLight),
    tiles: wp.array3d(dtype=wp.float32),
    tiles_out: wp.array3d(dtype=wp.float32),
):
    """Largest disc of a tile and its eight neighbours: all that can reach its pixels [px]."""
    slot, row, column = wp.tid()
    if lights[slot].active == 0:
        return
    radius = wp.float32(0.0)
    for i in range(3):
        y = wp.clamp(row + i - 1, 0, tiles.shape[1] - 1)
        for j in range(3):
            x = wp.clamp(column + j - 1, 0, tiles.shape[2] - 1)
            radius = wp.max(radius, tiles[slot, y, x])
    tiles_out[slot, row, column] = radius


@wp.kernel
def focus_kernel(
    # model
    focus: ThinLens,
    samples: wp.array(dtype=wp.vec3),
    turned: wp.array(dtype=wp.vec2),
    # state in
    lights: wp.array(dtype=SlotLight),
    image: wp.array4d(dtype=wp.float16),
    depth: wp.array3d(dtype=wp.float32),
    tiles: wp.array3d(dtype=wp.float32),
    # out
    image_out: wp.array4d(dtype=wp.float16),
):
    """Gather the discs that reach a pixel.

    A sample stands for radius^2 / TAPS of area; that share of its own disc's area is the light that
    it gives. Nearer samples before the focus cover the pixel, the others are averaged.
    """
    slot, row, column = wp.tid()
    if lights[slot].active == 0:
        return
    own = load(image, slot, row, column)
    own_depth = _distance(depth[slot, row, column])
    own_disc = _disc(focus, own_depth)
    reach = wp.max(own_disc, tiles[slot, row / focus.tile, column / focus.tile])
    if reach < _SHARP_PX:
        store(image_out, slot, row, column, own)
        return
    area = reach * reach / wp.float32(_TAPS)
    size = wp.max(own_disc, _SHARP_PX)
    behind_weight = wp.min(1.0, area / (size * size))
    behind = own * behind_weight
    before = wp.vec3(0.0, 0.0, 0.0)
    before_weight = wp.float32(0.0)
    turn = turned[(row & 3) * 4 + (column & 3)]
    for i in range(_TAPS):
        sample = samples[i] * reach
        x = column + wp.int32(wp.floor(turn[0] * sample[0] - turn[1] * sample[1] + 0.5))
        y = row + wp.int32(wp.floor(turn[1] * sample[0] + turn[0] * sample[1] + 0.5))
        if x >= 0 and y >= 0 and x < image.shape[2] and y < image.shape[1]:
            there = _distance(depth[slot, y, x])
            disc = own_disc
            if there < own_depth:
                disc = _disc(focus, there)
            cover = wp.min(disc - sample[2] + 0.5, 1.0)
            if cover > 0.0:
                size = wp.max(disc, _SHARP_PX)
                weight = cover * area / (size * size)
                color = load(image, slot, y, x) * weight
                if disc > own_disc:
                    before += color
                    before_weight += weight
                else:
                    behind += color
                    behind_weight += weight
    result = behind / behind_weight
    if before_weight > 0.0:
        share = wp.min(before_weight, 1.0)
        result = result * (1.0 - share) + before * (share / before_weight)
    store(image_out, slot, row, column, result)


class FocusBlur:
    """Depth of field of one camera; allocated once."""

    def __init__(self, focus: ThinLens, slots: int, height: int, width: int, device: wp.Device):
        self._focus = focus
        shape = (slots, *tile_grid(height, width))
        self._near = wp.zeros(shape, dtype=wp.float32, device=device)
        self._widened = wp.zeros(shape, dtype=wp.float32, device=device)
        self._taps = wp.array(taps(), dtype=wp.vec3, device=device)
        self._turns = wp.array(turns(), dtype=wp.vec2, device=device)

    def blur(self, lights: wp.array, image: wp.array, depth: wp.array, image_out: wp.array) -> None:
        """Draw ``image`` [S, H, W, 3] with ``depth`` [S, H, W] [m] out of focus."""
        device, tiles = image_out.device, self._near.shape
        for kernel, inputs, output in (
            (near_tiles_kernel, [self._focus, lights, depth], self._near),
            (widen_tiles_kernel, [lights, self._near], self._widened),
        ):
            wp.launch(kernel, tiles, inputs=inputs, outputs=[output], device=device)
        wp.launch(
            focus_kernel,
            image_out.shape[:3],
            inputs=[self._focus, self._taps, self._turns, lights, image, depth, self._widened],
            outputs=[image_out],
            device=device,
        )


def tile_grid(height: int, width: int) -> tuple[int, int]:
    """Rows and columns of tiles."""
    side = tile_px(height)
    return -(-height // side), -(-width // side)


def focus_bytes(slots: int, height: int, width: int) -> int:
    """Memory of :class:`FocusBlur` [bytes]."""
    rows, columns = tile_grid(height, width)
    return 2 * slots * rows * columns * 4 + TAPS * 12 + _TURNS * _TURNS * 8
