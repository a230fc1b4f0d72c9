"""Sines and powers that are the same on every machine: those of C libraries differ in last bits."""

from __future__ import annotations

import numpy as np

from twin.base.portable.host import sine_cosine

_LOG2_OF_10 = 3.321928094887362
_LOG_OF_2 = 0.6931471805599453
_TERMS = 15
"""Of the exponential's series: the first that is left out is below 1e-17 of the sum."""
_WHOLE_MAX = float(1 << 52)
"""Doubles below this hold every whole number and its halves."""


def rounded(values: np.ndarray) -> np.ndarray:
    """Values, float64 [N], rounded to nine decimals as Python's ``round`` does, exactly.

    A whole number of billionths below 2**53, divided by 1e9, is the double next to that decimal.
    Where the product with 1e9 lies so near to halfway between two that its own rounding might
    decide, Python's own rounding does.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        billionths = values * 1e9
        whole = np.rint(billionths)
        result: np.ndarray = whole / 1e9
        size = np.abs(billionths)
        sure = np.abs(np.abs(billionths - whole) - 0.5) > 1e-6 + 4e-16 * size
    for index in np.flatnonzero(~(sure & (size < _WHOLE_MAX))).tolist():
        result[index] = round(float(values[index]), 9)
    return result


def rounded_sine_cosine(angles_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sines and cosines of angles [rad], float64 [N], rounded to nine decimals; NaN of what is no
    number."""
    sines, cosines = sine_cosine(angles_rad)
    return rounded(sines), rounded(cosines)


def powers_of_ten(exponents: np.ndarray) -> np.ndarray:
    """10 to the power of ``exponents``, float64 [N], relative error below 1e-14 for magnitudes up
    to 20.

    The power of two of the whole part, times the exponential's series of the rest: sums, products
    and quotients in one order.
    """
    doublings = exponents * _LOG2_OF_10
    whole = np.floor(doublings + 0.5)
    rest = (doublings - whole) * _LOG_OF_2
    total = np.ones_like(rest)
    for n in range(_TERMS, 0, -1):
        total = 1.0 + rest * total / n
    powers: np.ndarray = np.ldexp(total, whole.astype(np.int64))
    return powers
