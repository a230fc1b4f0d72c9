"""Bloom: the share of the light that a lens scatters widely around where it belongs.

The picture is halved several times and blurred on the way; going up again each level is mixed with
the coarser one, which makes a point spread with a narrow core and wide skirts. Every step keeps the
mean of the picture, so light is moved and never made (exactly so at even sizes).
"""

from __future__ import annotations

import math

import warp as wp

from twin.render.light.light import SlotLight
from twin.render.post.pixels import between, corners, load, store

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_WIDER = wp.constant(0.65)
"""Share of a level that comes from the coarser one (chosen: a halo that fades over 30 px)."""
_LEVELS_MAX = 6
_ROWS_MIN = 12
"""Fewest rows of the coarsest level: the widest blur is that part of the picture's height."""


def level_sizes(height: int, width: int) -> list[tuple[int, int]]:
    """Rows and columns of every level, the finest (half the picture) first."""
    count = int(math.log2(max(2.0, min(height, width) / _ROWS_MIN)))
    sizes = []
    for _ in range(min(count, _LEVELS_MAX)):
        height, width = (height + 1) // 2, (width + 1) // 2
        sizes.append((height, width))
    return sizes


@wp.kernel
def halve_kernel(
    lights: wp.array(dtype=SlotLight),
    image: wp.array4d(dtype=wp.float16),
    half_out: wp.array4d(dtype=wp.float16),
):
    """Mean of 2x2 pixels; one thread per coarse pixel."""
    slot, row, column = wp.tid()
    if lights[slot].active == 0:
        return
    top = 2 * row
    left = 2 * column
    bottom = wp.min(top + 1, image.shape[1] - 1)
    right = wp.min(left + 1, image.shape[2] - 1)
    total = load(image, slot, top, left) + load(image, slot, top, right)
    total += load(image, slot, bottom, left) + load(image, slot, bottom, right)
    store(half_out, slot, row, column, total * 0.25)


@wp.func
def _weight(tap: wp.int32) -> wp.float32:
    """1, 3, 3, 1 eighths."""
    weight = wp.float32(0.125)
    if tap == 1 or tap == 2:
        weight = 0.375
    return weight


@wp.kernel
def blur_down_kernel(
    lights: wp.array(dtype=SlotLight),
    fine: wp.array4d(dtype=wp.float16),
    coarse_out: wp.array4d(dtype=wp.float16),
):
    """Halve with the weights 1, 3, 3, 1 across and down; the edge is repeated outside."""
    slot, row, column = wp.tid()
    if lights[slot].active == 0:
        return
    total = wp.vec3(0.0, 0.0, 0.0)
    for i in range(4):
        y = wp.clamp(2 * row - 1 + i, 0, fine.shape[1] - 1)
        line = wp.vec3(0.0, 0.0, 0.0)
        for j in range(4):
            x = wp.clamp(2 * column - 1 + j, 0, fine.shape[2] - 1)
            line += load(fine, slot, y, x) * _weight(j)
        total += line * _weight(i)
    store(coarse_out, slot, row, column, total)


@wp.kernel
def mix_up_kernel(
    lights: wp.array(dtype=SlotLight),
    coarse: wp.array4d(dtype=wp.float16),
    fine_out: wp.array4d(dtype=wp.float16),
):
    """Mix the coarser level into ``fine_out``, which is read and written at the own pixel only."""
    slot, row, column = wp.tid()
    if lights[slot].active == 0:
        return
    y = 0.5 * wp.float32(row) - 0.25
    x = 0.5 * wp.float32(column) - 0.25
    wide = between(coarse, slot, corners(y, x, coarse.shape[1], coarse.shape[2]))
    narrow = load(fine_out, slot, row, column)
    store(fine_out, slot, row, column, narrow * (1.0 - _WIDER) + wide * _WIDER)


class Bloom:
    """The levels of one camera; allocated once."""

    def __init__(self, slots: int, height: int, width: int, device: wp.Device) -> None:
        self.levels = [
            wp.zeros((slots, rows, columns, 3), dtype=wp.float16, device=device)
            for rows, columns in level_sizes(height, width)
        ]

    def spread(self, lights: wp.array, image: wp.array) -> wp.array:
        """Scatter ``image`` [S, H, W, 3]; returns the scattered light at half its size."""
        _over(halve_kernel, lights, image, self.levels[0])
        for fine, coarse in zip(self.levels, self.levels[1:], strict=False):
            _over(blur_down_kernel, lights, fine, coarse)
        for fine, coarse in zip(self.levels[-2::-1], self.levels[:0:-1], strict=True):
            _over(mix_up_kernel, lights, coarse, fine)
        return self.levels[0]


def _over(kernel: wp.Kernel, lights: wp.array, source: wp.array, target: wp.array) -> None:
    wp.launch(
        kernel,
        target.shape[:3],
        inputs=[lights, source],
        outputs=[target],
        device=target.device,
    )


def bloom_bytes(slots: int, height: int, width: int) -> int:
    """Memory of :class:`Bloom` [bytes]."""
    return sum(slots * rows * columns * 6 for rows, columns in level_sizes(height, width))
