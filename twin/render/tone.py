"""Conversion of linear signal to 8-bit sRGB by a table: the same bytes on every device."""

from __future__ import annotations

import numpy as np
import warp as wp

from twin.base.portable.quick import quotient
from twin.base.portable.whole import whole_within_f32
from twin.world.meshes.srgb import srgb

TABLE_LEN = 8192
"""Entries of the tone table."""
_TABLE_TOP = wp.constant(float(TABLE_LEN - 1))
_LAST = wp.constant(wp.int32(TABLE_LEN - 1))
_BRIGHTEST = wp.constant(wp.float32(1.0e30))


def tone_table() -> np.ndarray:
    """uint8 [TABLE_LEN]: the sRGB value of signal x stands at index x / (1 + x) (TABLE_LEN - 1).

    The curve keeps darks linear and rolls highlights off (Reinhard, extended, white at 6), then the
    sRGB transfer function of IEC 61966-2-1.
    """
    u = np.minimum(np.arange(TABLE_LEN) / (TABLE_LEN - 1), 1.0 - 1e-9)
    x = u / (1.0 - u)
    white = 6.0
    return np.round(255.0 * srgb(x * (1.0 + x / white**2) / (1.0 + x))).astype(np.uint8)


@wp.func
def tone(signal: wp.float32, table: wp.array(dtype=wp.uint8)) -> wp.uint8:
    """8-bit sRGB of a linear signal; white where it is infinite."""
    x = wp.min(wp.max(signal, 0.0), _BRIGHTEST)
    return table[whole_within_f32(quotient(x, 1.0 + x) * _TABLE_TOP + 0.5, 0, _LAST)]
