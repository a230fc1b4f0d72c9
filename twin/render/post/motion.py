"""Motion blur: the mean of what passes a pixel while the shutter is open.

A pixel averages along its own way; where something much faster is near, its taps also look along
that way for what passes over the pixel (after McGuire et al., A Reconstruction Filter for Plausible
Motion Blur, I3D 2012: the longest way of the neighbouring tiles leads to it).
"""

from __future__ import annotations

import math

import warp as wp

from twin.render.light.light import SlotLight
from twin.render.post.pixels import load, store

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_TAPS = wp.constant(8)
_SHORTEST_PX = wp.constant(0.5)
"""Shorter ways leave a pixel as it is."""
_FASTER = wp.constant(1.5)
_FASTER_PX = wp.constant(1.0)
"""What is faster than a pixel by this factor and length is another object, not its own surface."""
_BESIDE_PX = wp.constant(1.5)
"""Distance from the middle of its way at which an object still passes a pixel [px]."""


@wp.struct
class Shutter:
    """The shutter of a camera, for one size of image."""

    share: wp.float32
    """Open time over the frame's period [-]."""
    longest: wp.float32
    """Longest way that is drawn; its half reaches one tile far [px]."""
    tile: wp.int32
    """Side of a tile [px]."""


def tile_px(width: int) -> int:
    """Side of a tile: about a twentieth of the width [px]."""
    return max(4, 1 << round(math.log2(max(width, 64) / 20.0)))


def tile_grid(height: int, width: int) -> tuple[int, int]:
    """Rows and columns of tiles."""
    side = tile_px(width)
    return -(-height // side), -(-width // side)


@wp.func
def _way(
    shutter: Shutter,
    flow: wp.array4d(dtype=wp.float32),
    slot: wp.int32,
    row: wp.int32,
    column: wp.int32,
) -> wp.vec2:
    """Way of a pixel while the shutter is open, none where it is unknown [px]."""
    way = wp.vec2(flow[slot, row, column, 0], flow[slot, row, column, 1]) * -shutter.share
    length = wp.length(way)
    if not (length < 1.0e6):  # also a NaN
        way = wp.vec2(0.0, 0.0)
    elif length > shutter.longest:
        way = way * (shutter.longest / length)
    return way


@wp.kernel
def longest_rows_kernel(
    shutter: Shutter,
    lights: wp.array(dtype=SlotLight),
    flow: wp.array4d(dtype=wp.float32),
    rows_out: wp.array3d(dtype=wp.vec2),
):
    """Longest way in the pixels of every row that belong to one tile, the first of equal ones [px].

    A thread for a whole tile would leave most of a GPU idle.
    """
    slot, row, tile_column = wp.tid()
    if lights[slot].active == 0:
        return
    longest = wp.vec2(0.0, 0.0)
    first = tile_column * shutter.tile
    for column in range(first, wp.min(first + shutter.tile, flow.shape[2])):
        way = _way(shutter, flow, slot, row, column)
        if wp.length_sq(way) > wp.length_sq(longest):
            longest = way
    rows_out[slot, row, tile_column] = longest


@wp.kernel
def longest_tiles_kernel(
    shutter: Shutter,
    lights: wp.array(dtype=SlotLight),
    rows: wp.array3d(dtype=wp.vec2),
    tiles_out: wp.array3d(dtype=wp.vec2),
):
    """Longest way in every tile, the first of equal ones, from those of its rows [px]."""
    slot, tile_row, tile_column = wp.tid()
    if lights[slot].active == 0:
        return
    longest = wp.vec2(0.0, 0.0)
    first = tile_row * shutter.tile
    for row in range(first, wp.min(first + shutter.tile, rows.shape[1])):
        way = rows[slot, row, tile_column]
        if wp.length_sq(way) > wp.length_sq(longest):
            longest = way
    tiles_out[slot, tile_row, tile_column] = longest


@wp.kernel
def widen_tiles_kernel(
    lights: wp.array(dtype=SlotLight),
    tiles: wp.array3d(dtype=wp.vec2),
    tiles_out: wp.array3d(dtype=wp.vec2),
):
    """Longest way of a tile and its eight neighbours [px]."""
    slot, row, column = wp.tid()
    if lights[slot].active == 0:
        return
    longest = wp.vec2(0.0, 0.0)
    for i in range(3):
        y = wp.clamp(row + i - 1, 0, tiles.shape[1] - 1)
        for j in range(3):
            x = wp.clamp(column + j - 1, 0, tiles.shape[2] - 1)
            way = tiles[slot, y, x]
            if wp.length_sq(way) > wp.length_sq(longest):
                longest = way
    tiles_out[slot, row, column] = longest


@wp.func
def _tap(row: wp.int32, column: wp.int32, way: wp.vec2, i: wp.int32) -> wp.vec2:
    """Pixel (column, row) at the ``i``-th of the taps along ``way``, centred."""
    u = (wp.float32(i) + 0.5) / wp.float32(_TAPS) - 0.5
    return wp.vec2(
        wp.floor(wp.float32(column) + way[0] * u + 0.5),
        wp.floor(wp.float32(row) + way[1] * u + 0.5),
    )


@wp.func
def _passes(way: wp.vec2, to_pixel: wp.vec2) -> wp.bool:
    """Whether what goes ``way``, centred on itself, comes by the point ``to_pixel`` away."""
    length = wp.length(way)
    along = wp.abs(wp.dot(way, to_pixel)) / length
    beside = wp.abs(way[0] * to_pixel[1] - way[1] * to_pixel[0]) / length
    return along <= 0.5 * length and beside <= _BESIDE_PX


@wp.kernel
def motion_kernel(
    # model
    shutter: Shutter,
    # state in
    lights: wp.array(dtype=SlotLight),
    image: wp.array4d(dtype=wp.float16),
    flow: wp.array4d(dtype=wp.float32),
    depth: wp.array3d(dtype=wp.float32),
    tiles: wp.array3d(dtype=wp.vec2),
    # out
    image_out: wp.array4d(dtype=wp.float16),
):
    """Average along ``flow`` [S, H, W, 2] (x, y [px per frame]).

    The exposure is centred on the frame's time: half the way lies behind the pixel, half ahead, and
    whether flow points to the past or the future does not matter. ``depth`` [S, H, W] keeps what is
    behind a pixel from passing over it; a single element: not known, the faster is taken for the
    nearer.
    """
    slot, row, column = wp.tid()
    if lights[slot].active == 0:
        return
    color = load(image, slot, row, column)
    longest = tiles[slot, row / shutter.tile, column / shutter.tile]
    if wp.length_sq(longest) <= _SHORTEST_PX * _SHORTEST_PX:
        store(image_out, slot, row, column, color)
        return
    way = _way(shutter, flow, slot, row, column)
    length = wp.length(way)
    if length > _SHORTEST_PX:
        total = wp.vec3(0.0, 0.0, 0.0)
        for i in range(_TAPS):
            at = _tap(row, column, way, i)
            x = wp.clamp(wp.int32(at[0]), 0, image.shape[2] - 1)
            y = wp.clamp(wp.int32(at[1]), 0, image.shape[1] - 1)
            total += load(image, slot, y, x)
        color = total / wp.float32(_TAPS)
    faster = _FASTER * length + _FASTER_PX
    if wp.length(longest) > faster:
        passing = wp.vec3(0.0, 0.0, 0.0)
        count = wp.float32(0.0)
        for i in range(_TAPS):
            at = _tap(row, column, longest, i)
            x = wp.int32(at[0])
            y = wp.int32(at[1])
            if x >= 0 and y >= 0 and x < image.shape[2] and y < image.shape[1]:
                other = _way(shutter, flow, slot, y, x)
                apart = wp.vec2(wp.float32(x - column), wp.float32(y - row))
                if wp.length(other) > faster and _passes(other, apart):
                    behind = wp.bool(False)
                    if depth.shape[2] > 1:
                        behind = depth[slot, y, x] > depth[slot, row, column]
                    if not behind:
                        passing += load(image, slot, y, x)
                        count += 1.0
        color = (passing + color * (wp.float32(_TAPS) - count)) / wp.float32(_TAPS)
    store(image_out, slot, row, column, color)


class MotionBlur:
    """Motion blur of one camera; allocated once."""

    def __init__(
        self, share: float, slots: int, height: int, width: int, device: wp.Device
    ) -> None:
        """``share``: open time of the shutter over the frame's period [-]."""
        shutter = Shutter()
        shutter.share = share
        shutter.tile = tile_px(width)
        shutter.longest = 2.0 * shutter.tile
        self._shutter = shutter
        shape = (slots, *tile_grid(height, width))
        self._rows = wp.zeros((slots, height, shape[2]), dtype=wp.vec2, device=device)
        self._longest = wp.zeros(shape, dtype=wp.vec2, device=device)
        self._widened = wp.zeros(shape, dtype=wp.vec2, device=device)
        self._no_depth = wp.zeros((1, 1, 1), dtype=wp.float32, device=device)

    def blur(
        self,
        lights: wp.array,
        image: wp.array,
        flow: wp.array,
        depth: wp.array | None,
        image_out: wp.array,
    ) -> None:
        """Draw ``image`` [S, H, W, 3] moved by ``flow`` [S, H, W, 2] [px per frame]."""
        device = image_out.device
        for kernel, inputs, output in (
            (longest_rows_kernel, [self._shutter, lights, flow], self._rows),
            (longest_tiles_kernel, [self._shutter, lights, self._rows], self._longest),
            (widen_tiles_kernel, [lights, self._longest], self._widened),
        ):
            wp.launch(kernel, output.shape, inputs=inputs, outputs=[output], device=device)
        behind = self._no_depth if depth is None else depth
        wp.launch(
            motion_kernel,
            image_out.shape[:3],
            inputs=[self._shutter, lights, image, flow, behind, self._widened],
            outputs=[image_out],
            device=device,
        )


def motion_bytes(slots: int, height: int, width: int) -> int:
    """Memory of :class:`MotionBlur` [bytes]."""
    rows, columns = tile_grid(height, width)
    return slots * (height + 2 * rows) * columns * 8
