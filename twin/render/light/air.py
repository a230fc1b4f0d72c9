"""Air between camera and surface: extinction and airlight."""

from __future__ import annotations

import warp as wp

from twin.base.portable.quick import decay, quotient

# Depth of the layer that fog, rain and snow fill [m], and the extinction that is no weather [1/m]:
# the haze of clear air is part of the sky's own colour.
_LAYER_M = wp.constant(180.0)
_CLEAR_PER_M = wp.constant(2.0e-4)


@wp.func
def transmission(extinction: wp.float32, distance: wp.float32) -> wp.float32:
    """Share of light that passes ``distance`` [m] of air: e^(-b d)."""
    return decay(extinction * distance)


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
    """Length of the weather's path to the sky at direction cosine ``up`` [m]."""
    weather = wp.max(0.0, extinction - _CLEAR_PER_M)
    return quotient(_LAYER_M * weather, wp.max(up, 0.01) * wp.max(extinction, 1.0e-9))
