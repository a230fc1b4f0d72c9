"""Whole numbers of floats that may be anything, for indices.

A conversion of a float that is no number, or beyond an int32, gives another number on a CPU than on
a GPU, and as an index one far outside of any array. Within the bounds these functions give what
``wp.int32(x)`` gives; bounds up to 2**24 are exact.
"""

from __future__ import annotations

import warp as wp


@wp.func
def whole_within(x: wp.float64, low: wp.int32, high: wp.int32) -> wp.int32:
    """``x`` rounded towards 0, at least ``low`` and at most ``high``; no number: ``low``."""
    if x >= wp.float64(high):
        return high
    if x >= wp.float64(low):
        return wp.int32(x)
    return low


@wp.func
def whole_within_f32(x: wp.float32, low: wp.int32, high: wp.int32) -> wp.int32:
    """The float32 ``x`` rounded towards 0, at least ``low`` and at most ``high``; no number:
    ``low``."""
    if x >= wp.float32(high):
        return high
    if x >= wp.float32(low):
        return wp.int32(x)
    return low
