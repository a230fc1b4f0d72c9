"""The sky: a table of luminances, clouds that drift over it, the discs of sun and moon."""

from __future__ import annotations

import math

import warp as wp

from twin.base.portable.quick import dot, quotient, reciprocal, root
from twin.base.portable.whole import whole_within_f32
from twin.render.light.light import SlotLight
from twin.render.noise import value_noise
from twin.world.sky import sky_table

SKY_ROWS, SKY_COLUMNS = sky_table.ROWS, sky_table.COLUMNS
"""Shape of one slot's table; see :mod:`twin.world.sky.sky_table`."""

# Sun and moon have nearly the same apparent radius, 0.266 deg.
_DISC_PER_SINE = wp.constant(1.0 / math.sin(math.radians(0.2666)))
_DISC_COSINE = wp.constant(math.cos(math.radians(0.2666)))
# Luminance of the disc over its illuminance is 1 / 6.8e-5 sr; a half float holds this much.
_DISC_GAIN = wp.constant(4000.0)


@wp.func
def smooth_sky(
    direction: wp.vec3,
    slot: wp.int32,
    light: SlotLight,  # noqa: ARG001 - called like sky
    table: wp.array3d(dtype=wp.vec3),
) -> wp.vec3:
    """Luminance without clouds' shapes and discs, for mirrors [cd/m^2]; bilinear.

    Below the horizon it is as bright as at the horizon.
    """
    rows = table.shape[1]
    columns = table.shape[2]
    v = root(wp.clamp(direction[2], 0.0, 1.0)) * wp.float32(rows - 1)
    around = wp.max(wp.abs(direction[0]) + wp.abs(direction[1]), 1.0e-6)
    u = quotient(direction[1], around)
    if direction[0] < 0.0:
        u = 2.0 - u
    u = (u + 1.0) * 0.25 * wp.float32(columns)
    i = whole_within_f32(v, 0, rows - 2)
    j = whole_within_f32(u, 0, columns)
    a = v - wp.float32(i)
    b = u - wp.float32(j)
    j = wp.where(j >= columns, j - columns, j)
    k = wp.where(j + 1 >= columns, 0, j + 1)
    low = table[slot, i, j] * (1.0 - b) + table[slot, i, k] * b
    high = table[slot, i + 1, j] * (1.0 - b) + table[slot, i + 1, k] * b
    return low * (1.0 - a) + high * a


@wp.func
def _cloud_field(x: wp.float32, y: wp.float32) -> wp.float32:
    """Fractal noise in [0, 1); coordinates in heights of the clouds."""
    field = value_noise(x * 0.9, y * 0.9, 1) * 0.55
    field += value_noise(x * 2.1 + 5.0, y * 2.1, 2) * 0.29
    return field + value_noise(x * 4.7, y * 4.7 + 9.0, 3) * 0.16


@wp.func
def _cloud_density(field: wp.float32, cover: wp.float32) -> wp.float32:
    return wp.clamp((field - 0.70 + 0.55 * cover) * 3.5, 0.0, 1.0)


@wp.func
def sun_through_clouds(p: wp.vec3, light: SlotLight) -> wp.float32:
    """Share of the sun's beam that drifting clouds let through to ``p`` [-]."""
    up = wp.max(light.sun_direction[2], 0.07)
    steep = reciprocal(up)
    x = light.sun_direction[0] * steep + p[0] * (1.0 / 1500.0) - light.cloud_offset[0]
    y = light.sun_direction[1] * steep + p[1] * (1.0 / 1500.0) - light.cloud_offset[1]
    return 1.0 - 0.75 * _cloud_density(_cloud_field(x, y), light.cloud_cover)


@wp.func
def sky(
    direction: wp.vec3, slot: wp.int32, light: SlotLight, table: wp.array3d(dtype=wp.vec3)
) -> wp.vec3:
    """Luminance of the sky at ``direction`` with clouds, sun and moon [cd/m^2]."""
    color = smooth_sky(direction, slot, light, table)
    up = wp.max(direction[2], 0.0) + 0.07
    cover = light.cloud_cover
    steep = reciprocal(up)
    field = _cloud_field(
        direction[0] * steep - light.cloud_offset[0], direction[1] * steep - light.cloud_offset[1]
    )
    density = _cloud_density(field, cover) * wp.clamp(direction[2] * 4.0, 0.0, 1.0)
    clear = 1.0 - density
    toward = dot(direction, light.sun_direction)
    if light.shadows != 0 and toward > _DISC_COSINE:
        # Limb darkening 1 - 0.6 (1 - mu), mu: cosine on the sun's surface.
        w = (direction - light.sun_direction * toward) * _DISC_PER_SINE
        mu = root(1.0 - dot(w, w))
        color += light.sun_rgb * (_DISC_GAIN * (0.4 + 0.6 * mu) * clear)
    facing = dot(direction, light.moon_direction)
    if facing > _DISC_COSINE:
        # The sun is so far that it shines on the moon from where we see it.
        w = (direction - light.moon_direction * facing) * _DISC_PER_SINE
        front = root(1.0 - dot(w, w))
        lit = dot(w - light.moon_direction * front, light.sun_direction)
        color += light.moon_rgb * (wp.clamp(lit * 6.0, 0.0, 1.0) * clear)
    # Thin edges are bright, thick bellies dark; a closed cover keeps the table's brightness.
    belly = wp.clamp((field - 0.70 + 0.55 * cover) * 1.6, 0.0, 1.0)
    shade = 1.12 + 0.14 * cover - (0.30 + 0.35 * cover) * belly
    closed = wp.clamp((cover - 0.3) * 2.0, 0.0, 0.85)
    cloud = (light.cloud_rgb * (1.0 - closed) + color * closed) * shade
    return color * (1.0 - 0.9 * density) + cloud * (0.9 * density)
