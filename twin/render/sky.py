"""The sky: a gradient, a glow around the sun, clouds."""

from __future__ import annotations

import warp as wp

from twin.render.light import SlotLight
from twin.render.noise import value_noise


@wp.func
def smooth_sky(
    direction: wp.vec3, slot: wp.int32, light: SlotLight, table: wp.array3d(dtype=wp.vec3)
) -> wp.vec3:
    """Luminance without clouds, for mirrors [cd/m^2].

    A fit by eye between zenith and horizon, scaled to the diffuse illuminance; see
    :mod:`twin.world.sun`.
    """
    up = wp.clamp(direction[2], 0.0, 1.0)
    share = 1.0 - up
    share = share * share * share
    color = light.zenith_rgb * (1.0 - share) + light.horizon_rgb * share
    toward = wp.max(0.0, wp.dot(direction, light.sun_direction))
    halo = toward * toward
    halo = halo * halo
    halo = halo * halo
    return color + light.glow_rgb * (0.12 * halo * toward + 0.6 * halo * halo * halo * halo)


@wp.func
def sky(
    direction: wp.vec3, slot: wp.int32, light: SlotLight, table: wp.array3d(dtype=wp.vec3)
) -> wp.vec3:
    """Luminance of the sky at ``direction`` with clouds and sun disc [cd/m^2]."""
    color = smooth_sky(direction, slot, light, table)
    up = wp.max(direction[2], 0.0) + 0.07
    x = direction[0] / up
    y = direction[1] / up
    field = value_noise(x * 0.9, y * 0.9, 1) * 0.55
    field += value_noise(x * 2.1 + 5.0, y * 2.1, 2) * 0.29
    field += value_noise(x * 4.7, y * 4.7 + 9.0, 3) * 0.16
    cover = light.cloud_cover
    density = wp.clamp((field - 0.68 + 0.55 * cover) * 3.5, 0.0, 1.0)
    density = density * wp.min(1.0, up * 3.0)
    bright = light.sky_rgb * (0.40 - 0.20 * cover) + light.sun_rgb * 0.10
    shade = 1.0 - 0.45 * density * (1.0 - 0.4 * field)
    color = color * (1.0 - 0.75 * density) + bright * (0.75 * density * shade)
    if light.shadows != 0:
        toward = wp.dot(direction, light.sun_direction)
        if toward > 0.9996:
            color += light.sun_rgb * 4.0
    return color
