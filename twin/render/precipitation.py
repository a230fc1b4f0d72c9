"""Raindrops and snowflakes close to the camera, drawn in the image plane."""

from __future__ import annotations

import warp as wp

from twin.render.light import SlotLight
from twin.render.noise import draw, uniform

# Elements of a stream below this belong to pixels.
_FIRST_ELEMENT = wp.constant(1 << 27)


@wp.func
def cover(u: wp.float32, v: wp.float32, light: SlotLight) -> wp.float32:
    """Share of the pixel at (u, v), in image heights, that drops or flakes hide [-].

    Two layers of cells, each with at most one streak (rain) or flake (snow), redrawn every frame.
    """
    hidden = wp.float32(0.0)
    amount = wp.max(light.rain, light.snow)
    for layer in range(2):
        scale = 9.0 + 13.0 * wp.float32(layer)
        tall = wp.where(light.rain > 0.0, 0.38, 1.0)
        x = u * scale
        y = v * scale * tall
        i = wp.int32(wp.floor(x))
        j = wp.int32(wp.floor(y))
        bits = draw(light.key, light.tick, _FIRST_ELEMENT + layer * 1048576 + j * 1024 + i)
        if uniform(bits) < 0.25 + 0.5 * amount:
            again = draw(light.key, light.tick, _FIRST_ELEMENT + 4194304 + j * 1024 + i + layer)
            cx = 0.2 + 0.6 * uniform(again)
            cy = 0.3 + 0.4 * uniform(again * wp.uint64(0x9E3779B97F4A7C15))
            dx = x - wp.float32(i) - cx
            dy = y - wp.float32(j) - cy
            if light.rain > 0.0:
                if wp.abs(dx + 0.05 * dy) < 0.022 and wp.abs(dy) < 0.28:
                    hidden = wp.max(hidden, 0.16 + 0.12 * amount)
            else:
                near = 1.0 - (dx * dx + dy * dy) / 0.008
                hidden = wp.max(hidden, 0.75 * wp.clamp(near * 1.5, 0.0, 1.0))
    return hidden
