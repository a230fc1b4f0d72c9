"""The exponential of NumPy arrays with the same bits on every processor.

NumPy chooses its own by instruction set, and their last bits differ. This one is made of sums,
products and powers of two, which IEEE 754 rounds in one way: with ``x = k log(2) + r`` (Cody and
Waite, "Software Manual for the Elementary Functions", 1980, chapter 6), e^x is 2^k times the Taylor
series of e^r, whose remainder is below 2^-56 for |r| <= log(2) / 2.
"""

from __future__ import annotations

from math import factorial

import numpy as np

TERMS = 14
"""Terms of the series behind the 1."""

_SERIES = tuple(1.0 / factorial(power) for power in range(TERMS, 0, -1))
"""Coefficients, the highest power's first."""

_LOG2_HIGH = float.fromhex("0x1.62e42fee00000p-1")
_LOG2_LOW = float.fromhex("0x1.a39ef35793c76p-33")
"""log(2) in two parts: products of the first with whole numbers below 2^20 are exact."""


def exponential(values: np.ndarray) -> np.ndarray:
    """e to the power of ``values``, float64, within two units of the last place; 0 below -745,
    infinite above 709.7; NaN of NaN."""
    x = np.clip(np.asarray(values, np.float64), -800.0, 800.0)
    with np.errstate(invalid="ignore"):
        k = np.rint(x * (1.0 / (_LOG2_HIGH + _LOG2_LOW)))
        r = (x - k * _LOG2_HIGH) - k * _LOG2_LOW
        series = _SERIES[0] * r
        for coefficient in _SERIES[1:]:
            series = (series + coefficient) * r
        with np.errstate(over="ignore", under="ignore"):
            return np.ldexp(1.0 + series, np.nan_to_num(k).astype(np.int32))
