"""From real numbers to levels: ranges of maps, levels of kernels, factors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from schemas.steady import steady

LOW_SHARES = np.linspace(0.5, 1.0, 6)
HIGH_SHARES = np.linspace(0.3, 1.0, 29)
"""Shares of the least and of the largest value that are tried as ends of a range."""

STEP_BITS = 12
"""Bits of a map's scale."""

FACTOR_BITS = 31
"""Factors are below two to the power of this."""


@dataclass(frozen=True, slots=True)
class LevelScale:
    """A map's scale: real value = ``step`` x (level - ``zero``)."""

    step: float
    zero: int


def scale_of(values: np.ndarray, least: float, largest: float) -> LevelScale:
    """The scale with the least squared error.

    Args:
        values: a sample of what the map holds, of real pictures.
        least, largest: of all values of all pictures.
    """
    sample = values.astype(np.float64)
    best, least_error = LevelScale(1.0, -128), math.inf
    for low in LOW_SHARES * min(least, 0.0):
        for high in HIGH_SHARES * max(largest, 0.0):
            scale = _scale(low, high)
            levels = np.clip(np.rint(sample / scale.step) + scale.zero, -128, 127)
            error = float(np.square(sample - (levels - scale.zero) * scale.step).sum())
            if error < least_error:
                best, least_error = scale, error
    return best


def _scale(low: float, high: float) -> LevelScale:
    # Rounded, so that the last bits of whoever ran the float network do not reach the file.
    step = float(steady((high - low) / 255.0, STEP_BITS)) or 1.0
    return LevelScale(step, int(np.clip(round(-128 - low / step), -128, 127)))


def kernel_levels(kernels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Levels and scales of every output channel: the largest magnitude is 127.

    Args:
        kernels: float64 [outs, ...].

    Returns:
        int64 of the same shape, and float64 [outs], above 0.
    """
    largest = np.abs(kernels).reshape(len(kernels), -1).max(axis=1)
    scales = np.where(largest > 0.0, largest, 127.0) / 127.0
    shape = (-1, *(1,) * (kernels.ndim - 1))
    return np.rint(kernels / scales.reshape(shape)).astype(np.int64), scales


def factor_of(value: float, bits: int = FACTOR_BITS) -> tuple[int, int]:
    """A positive number as factor and shift: ``factor / 2**shift``, the factor of ``bits`` bits
    unless the number is tiny.

    Raises:
        ValueError: it is 2^30 or more.
    """
    _, exponent = math.frexp(value)
    shift = bits - exponent
    if shift < 1:
        raise ValueError(f"a factor of {value:g} between two maps")
    if shift > 62:
        shift = 62
    factor = round(math.ldexp(value, shift))
    if factor >= 1 << bits:  # rounded up to the next power of two
        factor, shift = factor // 2, shift - 1
    return factor, shift
