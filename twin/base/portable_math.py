"""Sine, cosine and arc tangent for kernels, under the names that kernels of roads use."""

from __future__ import annotations

import warp as wp


@wp.func
def portable_sin(x: wp.float64) -> wp.float64:
    """The sine of an angle [rad]."""
    return wp.sin(x)


@wp.func
def portable_cos(x: wp.float64) -> wp.float64:
    """The cosine of an angle [rad]."""
    return wp.cos(x)


@wp.func
def portable_atan2(y: wp.float64, x: wp.float64) -> wp.float64:
    """The angle of (x, y) in [-pi, pi] [rad]."""
    return wp.atan2(y, x)
