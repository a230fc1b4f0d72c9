"""Sines and powers that are the same on every machine: those of C libraries differ in last bits."""

from __future__ import annotations

import math

import numpy as np

from twin.base.portable.host import sine_cosine

_LOG2_OF_10 = 3.321928094887362
_LOG_OF_2 = 0.6931471805599453
_TERMS = 15
"""Of the exponential's series: the first that is left out is below 1e-17 of the sum."""


def rounded_sine_cosine(angles_rad: np.ndarray) -> tuple[list[float], list[float]]:
    """Sines and cosines of angles [rad], float64 [N], rounded to nine decimals; NaN of what is no
    number."""
    sines, cosines = sine_cosine(angles_rad)
    return [round(x, 9) for x in sines.tolist()], [round(x, 9) for x in cosines.tolist()]


def power_of_ten(exponent: float) -> float:
    """10 to the power of ``exponent``, relative error below 1e-14 for magnitudes up to 20.

    The power of two of the whole part, times the exponential's series of the rest: sums, products
    and quotients in one order.
    """
    doublings = exponent * _LOG2_OF_10
    whole = math.floor(doublings + 0.5)
    rest = (doublings - whole) * _LOG_OF_2
    total = 1.0
    for n in range(_TERMS, 0, -1):
        total = 1.0 + rest * total / n
    return math.ldexp(total, whole)
