"""Raindrops and snowflakes before the camera, drawn in the image plane.

They hang in layers of depth. In a layer each lane, a narrow column of the picture, is a band of
cells that moves down with the fall; a cell holds at most one drop or flake, at a place that belongs
to the cell. So a drop moves from frame to frame as it falls, and is not another one each time.
A drop leaves a streak as long as it falls while the shutter is open. How many there are follows
from the rate: the water in the air is rate over fall speed.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable.quick import quotient
from twin.render.light.light import SlotLight
from twin.render.noise import lattice

# Inverse of the focal length in image heights of a camera of 70 deg at 16:9; others see drops a
# little off size.
_PER_FOCAL = wp.constant(1.0 / 1.27)
_LAYERS = wp.constant(4)
# Width of a lane of rain, as lanes per metre, and pitch of the flakes next to the camera [m].
_PER_LANE = wp.constant(1.0 / 0.055)
_FLAKE_GRID_M = wp.constant(0.10)
DROPS_MASK = 0xFFFFF
"""Bits of a camera's key that say where drops and flakes are."""
_SEED_MASK = wp.constant(wp.uint64(DROPS_MASK))


@wp.func
def _lower(number: wp.float32, scale: wp.float32) -> wp.float32:
    """Another random number in [0, 1) from the lower bits of a lattice's 24."""
    x = number * scale
    return x - wp.floor(x)


@wp.func
def _streak(u: wp.float32, v: wp.float32, slant: wp.float32, light: SlotLight) -> wp.float32:
    """Share of the pixel that streaks of rain hide [-]."""
    hidden = wp.float32(0.0)
    seed = wp.int32(light.key & _SEED_MASK)
    depth = wp.float32(1.6)
    for layer in range(_LAYERS):
        per = depth * _PER_FOCAL  # metres per image height
        x = (u - slant * v) * per * _PER_LANE
        i = wp.int32(wp.floor(x))
        own = lattice(i, layer, seed)
        speed = light.fall_mps * (0.85 + 0.3 * own)
        # An eye, or a codec, sees streaks longer than the shutter makes them.
        length = 0.16 + speed * light.shutter_s
        cell = wp.max(0.9, 2.5 * length)
        y = quotient(v * per - light.fallen_m * (0.85 + 0.3 * own), cell) + 64.0 * own
        j = wp.int32(wp.floor(y))
        dice = lattice(i, j, seed + 7 + layer)
        if dice < 0.16 + 0.74 * light.rain:
            wide = 0.024 + 0.018 * wp.float32(layer)
            dx = x - wp.float32(i) - (0.2 + 0.6 * _lower(dice, 256.0))
            near = 1.0 - quotient(wp.abs(dx), wide)
            if near > 0.0:
                half = quotient(0.5 * length, cell)
                centre = half + (1.0 - 2.0 * half) * _lower(dice, 65536.0)
                dy = quotient(y - wp.float32(j) - centre, half)
                strength = 0.40 - 0.05 * wp.float32(layer)
                fade = wp.min(1.0, 1.6 * near) * wp.max(0.0, 1.0 - dy * dy)
                hidden = wp.max(hidden, strength * fade)
        depth = depth * 1.9
    return hidden


@wp.func
def _flakes(u: wp.float32, v: wp.float32, slant: wp.float32, light: SlotLight) -> wp.float32:
    """Share of the pixel that snowflakes hide [-]."""
    hidden = wp.float32(0.0)
    seed = wp.int32(light.key & _SEED_MASK) + 1048576
    depth = wp.float32(1.3)
    grid = wp.float32(_FLAKE_GRID_M)
    for layer in range(_LAYERS):
        fine = quotient(depth * _PER_FOCAL, grid)  # further layers are denser
        x = (u - slant * v) * fine
        column = wp.int32(wp.floor(x))
        own = lattice(column, layer, seed)
        y = v * fine - quotient(light.fallen_m * (0.8 + 0.4 * own), grid) + 64.0 * own
        j = wp.int32(wp.floor(y))
        dice = lattice(column, j, seed + 7 + layer)
        if dice < 0.06 + 0.62 * light.snow:
            # It swings to and fro while it falls.
            swing = wp.abs(2.0 * _lower(0.35 * light.time_s + 7.0 * dice, 1.0) - 1.0) - 0.5
            dx = x - wp.float32(column) - 0.5 - 0.56 * swing
            dy = y - wp.float32(j) - (0.25 + 0.5 * _lower(dice, 256.0))
            radius = 0.055 + 0.05 * _lower(dice, 65536.0)
            radius = radius * (1.0 + 0.25 * wp.float32(layer))
            near = 1.0 - quotient(dx * dx + dy * dy, radius * radius)
            strength = 0.95 - 0.12 * wp.float32(layer)
            hidden = wp.max(hidden, strength * wp.clamp(near * 1.5, 0.0, 1.0))
        depth = depth * 1.8
        grid = grid * 0.86
    return hidden


@wp.func
def cover(u: wp.float32, v: wp.float32, right: wp.vec3, light: SlotLight) -> wp.float32:
    """Share of the pixel at (u, v), in image heights, that drops or flakes hide [-].

    ``right``: of the camera, world.
    """
    slant = light.slant[0] * right[0] + light.slant[1] * right[1]
    hidden = wp.float32(0.0)
    if light.rain > 0.0:
        hidden = _streak(u, v, slant, light)
    if light.snow > 0.0:
        hidden = wp.max(hidden, _flakes(u, v, slant, light))
    return hidden
