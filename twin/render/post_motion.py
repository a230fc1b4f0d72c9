"""Motion blur: the mean of the picture along each pixel's way while the shutter is open."""

from __future__ import annotations

import warp as wp

from twin.render.light import SlotLight
from twin.render.post_pixels import load, store

wp.set_module_options({"enable_backward": False, "fast_math": False})

_TAPS = wp.constant(8)
_SHORTEST_PX = wp.constant(0.5)
"""Shorter ways leave a pixel as it is."""


@wp.kernel
def motion_kernel(
    # model
    share: wp.float32,
    longest_px: wp.float32,
    # state in
    lights: wp.array(dtype=SlotLight),
    image: wp.array4d(dtype=wp.float16),
    flow: wp.array4d(dtype=wp.float32),
    # out
    image_out: wp.array4d(dtype=wp.float16),
):
    """Average along ``flow`` [S, H, W, 2] (x, y [px per frame]).

    The exposure is centred on the frame's time: half the way lies behind the pixel, half ahead, and
    whether flow points to the past or the future does not matter. ``share``: open time of the
    shutter over the frame's period [-]. A pixel gathers along its own way: what stands still beside
    a moving object keeps its edge.
    """
    slot, row, column = wp.tid()
    if lights[slot].active == 0:
        return
    way_x = flow[slot, row, column, 0] * share
    way_y = flow[slot, row, column, 1] * share
    length = wp.sqrt(way_x * way_x + way_y * way_y)
    if not (length > _SHORTEST_PX):  # also a NaN
        store(image_out, slot, row, column, load(image, slot, row, column))
        return
    shorten = wp.min(1.0, longest_px / length)
    way_x *= shorten
    way_y *= shorten
    total = wp.vec3(0.0, 0.0, 0.0)
    for i in range(_TAPS):
        u = (wp.float32(i) + 0.5) / wp.float32(_TAPS) - 0.5
        x = wp.clamp(
            wp.int32(wp.floor(wp.float32(column) + way_x * u + 0.5)), 0, image.shape[2] - 1
        )
        y = wp.clamp(wp.int32(wp.floor(wp.float32(row) + way_y * u + 0.5)), 0, image.shape[1] - 1)
        total += load(image, slot, y, x)
    store(image_out, slot, row, column, total / wp.float32(_TAPS))
