"""Numbers that are the same on every host."""

from __future__ import annotations

import numpy as np


def steady(values: object, bits: int = 18) -> np.ndarray:
    """``values`` rounded to so many significant bits, float64 of their shape.

    Exponentials, powers and sines end in other last bits on other hosts: NumPy and the C library
    choose their code by instruction set. Rounding keeps those bits out of what a sensor sees, a
    vehicle feels and a detector reports.
    """
    mantissa, exponent = np.frexp(np.asarray(values, np.float64))
    return np.ldexp(np.round(mantissa * 2.0**bits) * 2.0**-bits, exponent)
