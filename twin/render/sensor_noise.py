"""Shot and read noise of an image sensor: the last thing added before a signal becomes 8 bits."""

from __future__ import annotations

import warp as wp

from twin.base.portable.quick import root
from twin.render.noise import draw, normal

# Signal of a white surface in electrons, and read noise relative to it.
PER_FULL_WELL = wp.constant(1.0 / 7000.0)
READ_NOISE = wp.constant(1.2e-3)


@wp.func
def sensor_noise(x: wp.float32, key: wp.uint64, tick: wp.int32, element: wp.int32) -> wp.float32:
    """Signal ``x`` with its noise; ``element`` counts the values of an image, row by row, RGB."""
    sigma = root(wp.max(x, 0.0) * PER_FULL_WELL + READ_NOISE * READ_NOISE)
    return x + sigma * normal(draw(key, tick, element))
