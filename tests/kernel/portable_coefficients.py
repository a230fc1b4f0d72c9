"""Derives the coefficients of ``twin.base.portable`` and prints them as its coefficients.

    PYTHONPATH=tests python tests/kernel/portable_coefficients.py

Each function is smooth in ``z = r * r`` (the exponential in ``r``) on a short interval. Its
interpolant at Chebyshev's points of that interval is computed with 80 digits and rounded to
float64, coefficient by coefficient. Parts of constants keep so few bits that their products with
the integers of a reduction are exact.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath

mpmath.mp.dps = 80
Real = Any
PI = mpmath.pi
ROOM = mpmath.mpf("1.001")
"""Intervals are this much wider than a reduction needs, so that rounding does not leave them."""


def interpolant(function: Callable[[Real], Real], low: Real, high: Real, count: int) -> list[float]:
    """Coefficients, constant first, of the polynomial that agrees at ``count`` Chebyshev points.

    ``function`` is not called at zero as long as ``count`` is even or the interval begins there.
    """
    middle, half = (low + high) / 2, (high - low) / 2
    points = [middle + half * mpmath.cos(PI * (2 * i + 1) / (2 * count)) for i in range(count)]
    matrix = mpmath.matrix([[point**power for power in range(count)] for point in points])
    values = mpmath.matrix([function(point) for point in points])
    return [float(value) for value in mpmath.lu_solve(matrix, values)]


def parts(value: Real, bits: int, count: int) -> list[float]:
    """``count`` floats that add up to ``value``; all but the last have at most ``bits`` bits."""
    pieces = []
    for _ in range(count - 1):
        exponent = int(mpmath.floor(mpmath.log(abs(value), 2))) + 1
        scale = mpmath.mpf(2) ** (bits - exponent)
        piece = mpmath.floor(value * scale) / scale
        pieces.append(float(piece))
        value -= piece
    return [*pieces, float(value)]


def sine(z: Real) -> Real:
    """``(sin r - r) / r**3``, of ``z = r * r``."""
    r = mpmath.sqrt(z)
    return (mpmath.sin(r) - r) / r**3


def cosine(z: Real) -> Real:
    """``(cos r - 1 + z / 2) / z**2``, of ``z = r * r``."""
    return (mpmath.cos(mpmath.sqrt(z)) - 1 + z / 2) / z**2


def arctangent(z: Real) -> Real:
    """``(atan r - r) / r**3``, of ``z = r * r``."""
    r = mpmath.sqrt(z)
    return (mpmath.atan(r) - r) / r**3


def exponential(r: Real) -> Real:
    """``(exp r - 1 - r) / r**2``."""
    return (mpmath.exp(r) - 1 - r) / r**2


def logarithm(z: Real) -> Real:
    """``(log((1 + s) / (1 - s)) - 2 s) / s**3``, of ``z = s * s``."""
    s = mpmath.sqrt(z)
    return (2 * mpmath.atanh(s) - 2 * s) / s**3


def logarithm_tail(z: Real) -> Real:
    """``(log((1 + s) / (1 - s)) - 2 s - 2/3 s**3) / s**5``, of ``z = s * s``."""
    s = mpmath.sqrt(z)
    return (2 * mpmath.atanh(s) - 2 * s - 2 * s**3 / 3) / s**5


def hyperbolic(z: Real) -> Real:
    """``(tanh r - r) / r**3``, of ``z = r * r``."""
    r = mpmath.sqrt(z)
    return (mpmath.tanh(r) - r) / r**3


def constants() -> dict[str, float]:
    """All constants by the names they have in ``twin.base.portable``."""
    quarter = (PI / 4 * ROOM) ** 2
    eighth = (mpmath.tan(PI / 8) * ROOM) ** 2
    half_log = mpmath.log(2) / 2 * ROOM
    root = mpmath.sqrt(2)
    slope = ((root - 1) / (root + 1) * ROOM) ** 2
    zero = mpmath.mpf(0)
    table = {
        "SIN": interpolant(sine, zero, quarter, 7),
        "COS": interpolant(cosine, zero, quarter, 7),
        "ATAN": interpolant(arctangent, zero, eighth, 12),
        "EXP": interpolant(exponential, -half_log, half_log, 12),
        "EXP_SHORT": interpolant(exponential, -half_log, half_log, 6),
        "LOG": interpolant(logarithm, zero, slope, 8),
        "LOG_TAIL": interpolant(logarithm_tail, zero, slope, 8),
        "TANH": interpolant(hyperbolic, zero, (mpmath.mpf(1) / 4 * ROOM) ** 2, 9),
        "HALF_PI_PART": parts(PI / 2, 33, 4),
        "LN2_PART": parts(mpmath.log(2), 40, 2),
        "LN2_SHORT": parts(mpmath.log(2), 12, 2),
        "HALF_PI": parts(PI / 2, 53, 2),
        "QUARTER_PI": parts(PI / 4, 53, 2),
        "THREE_QUARTERS_PI": parts(3 * PI / 4, 53, 2),
        "PI": parts(PI, 53, 2),
        "TWO_THIRDS": parts(mpmath.mpf(2) / 3, 53, 2),
    }
    named = {f"{name}_{i}": value for name, row in table.items() for i, value in enumerate(row)}
    return named | {
        "TWO_OVER_PI": float(2 / PI),
        "ONE_OVER_LN2": float(1 / mpmath.log(2)),
        "TAN_PI_8": float(mpmath.tan(PI / 8)),
    }


if __name__ == "__main__":
    for name, value in constants().items():
        print(f"{name} = {value!r}")
