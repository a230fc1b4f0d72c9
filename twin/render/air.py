"""Air between camera and surface: extinction, airlight, and the glow of the ego's own lamps."""

from __future__ import annotations

import warp as wp


@wp.func
def transmission(extinction: wp.float32, distance: wp.float32) -> wp.float32:
    """Share of light that passes ``distance`` [m] of air: e^(-b d)."""
    return wp.exp(-extinction * distance)


@wp.func
def through_air(
    surface: wp.vec3, air: wp.vec3, extinction: wp.float32, distance: wp.float32
) -> wp.vec3:
    """Luminance seen through ``distance`` [m] of air (Koschmieder).

    L = L0 e^(-b d) + L_air (1 - e^(-b d)), V = 3.912 / b.
    """
    t = transmission(extinction, distance)
    return surface * t + air * (1.0 - t)


@wp.func
def sky_path(extinction: wp.float32, up: wp.float32) -> wp.float32:
    """Length of the hazy path to the sky at direction cosine ``up`` [m].

    Fog, rain and snow fill a layer of 180 m; clear air's haze is part of the sky's own colour.
    """
    if extinction < 1.0e-3:
        return 0.0
    return 180.0 / wp.max(up, 0.02)
