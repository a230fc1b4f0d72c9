"""Reading and writing linear pixels: three 16-bit floats in memory, three 32-bit ones in hand."""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

SIGNAL_MAX = wp.constant(60000.0)
"""Brightest signal that is kept: just below what 16-bit floats hold [-]."""


@wp.func
def load(image: wp.array4d(dtype=wp.float16), slot: wp.int32, row: wp.int32, column: wp.int32):
    """The pixel, no brighter than :data:`SIGNAL_MAX`."""
    return wp.vec3(
        wp.min(wp.float32(image[slot, row, column, 0]), SIGNAL_MAX),
        wp.min(wp.float32(image[slot, row, column, 1]), SIGNAL_MAX),
        wp.min(wp.float32(image[slot, row, column, 2]), SIGNAL_MAX),
    )


@wp.func
def store(
    image: wp.array4d(dtype=wp.float16),
    slot: wp.int32,
    row: wp.int32,
    column: wp.int32,
    color: wp.vec3,
):
    """Write the pixel."""
    image[slot, row, column, 0] = wp.float16(color[0])
    image[slot, row, column, 1] = wp.float16(color[1])
    image[slot, row, column, 2] = wp.float16(color[2])


@wp.struct
class Corners:
    """Four neighbouring pixels and the weights between them."""

    top: wp.int32
    bottom: wp.int32
    left: wp.int32
    right: wp.int32
    down: wp.float32
    across: wp.float32


@wp.func
def corners(row: wp.float32, column: wp.float32, height: wp.int32, width: wp.int32) -> Corners:
    """Neighbours of a point, whole numbers being pixel centres; the edge goes on outside."""
    found = Corners()
    top = wp.floor(row)
    left = wp.floor(column)
    found.down = row - top
    found.across = column - left
    found.top = wp.clamp(wp.int32(top), 0, height - 1)
    found.bottom = wp.clamp(wp.int32(top) + 1, 0, height - 1)
    found.left = wp.clamp(wp.int32(left), 0, width - 1)
    found.right = wp.clamp(wp.int32(left) + 1, 0, width - 1)
    return found


@wp.func
def between(image: wp.array4d(dtype=wp.float16), slot: wp.int32, at: Corners) -> wp.vec3:
    """Bilinear colour."""
    upper = load(image, slot, at.top, at.left) * (1.0 - at.across)
    upper += load(image, slot, at.top, at.right) * at.across
    lower = load(image, slot, at.bottom, at.left) * (1.0 - at.across)
    lower += load(image, slot, at.bottom, at.right) * at.across
    return upper * (1.0 - at.down) + lower * at.down


@wp.func
def between_one(
    image: wp.array4d(dtype=wp.float16), slot: wp.int32, at: Corners, channel: wp.int32
) -> wp.float32:
    """Bilinear value of one channel."""
    upper = wp.float32(image[slot, at.top, at.left, channel]) * (1.0 - at.across)
    upper += wp.float32(image[slot, at.top, at.right, channel]) * at.across
    lower = wp.float32(image[slot, at.bottom, at.left, channel]) * (1.0 - at.across)
    lower += wp.float32(image[slot, at.bottom, at.right, channel]) * at.across
    return wp.min(upper * (1.0 - at.down) + lower * at.down, SIGNAL_MAX)
