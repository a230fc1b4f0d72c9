"""The portable sine, cosine, tangent and inverse tangent for arrays on the host.

NumPy's own choose their code by instruction set and differ in their last bits. These take the steps
of the kernels' functions (:mod:`twin.base.portable.circle`, :mod:`twin.base.portable.arcs`) with
NumPy's sums, products and quotients, which are the same everywhere, and give the same bits. Angles
of magnitudes beyond 2**40 are NaN.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from twin.base.portable import coefficients

Floats = npt.NDArray[np.float64]

_SMALLEST = 1.0e-150
_LIMIT_RAD = 2.0**40
_SHORT = 2.0**-30
_SPLITTER = 134217729.0


@cache
def _constant(name: str) -> float:
    return float(getattr(coefficients, name))


@cache
def _coefficients(name: str, last: int) -> tuple[float, ...]:
    """Coefficients ``name_last`` to ``name_0``."""
    return tuple(_constant(f"{name}_{k}") for k in range(last, -1, -1))


def _series(z: Floats, name: str, last: int) -> Floats:
    """``c_0 + z (c_1 + z (...))`` of coefficients ``name_k``."""
    highest, *lower = _coefficients(name, last)
    total = lower[0] + z * highest
    for coefficient in lower[1:]:
        total = coefficient + z * total
    return total


def _exact_sum(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    total = a + b
    b_share = total - a
    return total, (a - (total - b_share)) + (b - b_share)


def _exact_product(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    product = a * b
    a_spread, b_spread = a * _SPLITTER, b * _SPLITTER
    a_high, b_high = a_spread - (a_spread - a), b_spread - (b_spread - b)
    a_low, b_low = a - a_high, b - b_high
    return product, ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low


def _parts(x: Floats) -> tuple[Floats, Floats, npt.NDArray[np.int64]]:
    """Sine and cosine of the remainder of ``x`` by pi/2, and the number of the quarter turn."""
    two_over_pi, *half_pi = _reduction()
    turns = np.floor(x * two_over_pi + 0.5)
    sine, cosine = _remainder(x, turns, *half_pi)
    return sine, cosine, turns.astype(np.int64) & 3


@cache
def _reduction() -> tuple[float, ...]:
    """2 / pi, and the parts of pi / 2."""
    return (_constant("TWO_OVER_PI"), *(_constant(f"HALF_PI_PART_{k}") for k in range(4)))


def _remainder(
    x: Any, turns: Any, half_pi_0: float, half_pi_1: float, half_pi_2: float, half_pi_3: float
) -> tuple[Any, Any]:
    """Sine and cosine of the remainder of ``x`` by pi/2; arrays or numbers."""
    first, first_rest = _exact_sum(x, -(turns * half_pi_0))
    second, second_rest = _exact_sum(first, -(turns * half_pi_1))
    third, third_rest = _exact_sum(second, -(turns * half_pi_2))
    lost = third_rest + (second_rest + first_rest) - turns * half_pi_3
    r = third + lost
    rest = lost - (r - third)
    z = r * r
    sine = r + (rest * (1.0 - 0.5 * z) + r * z * _series(z, "SIN", 6))
    most = 1.0 + -(0.5 * z)
    gone = -(0.5 * z) - (most - 1.0)
    cosine = most + (gone + (z * z * _series(z, "COS", 6) - r * rest))
    return sine, cosine


def _angles(x: npt.ArrayLike) -> tuple[Floats, npt.NDArray[np.bool_]]:
    angles = np.asarray(x, np.float64)
    known = np.abs(angles) <= _LIMIT_RAD
    return np.where(known, angles, 0.0), known


def _sine_cosine_of_one(x: float) -> tuple[float, float]:
    """Sine and cosine of one angle, by the same steps with Python's numbers: building a road asks a
    hundred thousand times for one, and each step of NumPy takes as long for one as for many."""
    if not abs(x) <= _LIMIT_RAD:
        return math.nan, math.nan
    two_over_pi, *half_pi = _reduction()
    turns = float(math.floor(x * two_over_pi + 0.5))
    s, c = _remainder(x, turns, *half_pi)
    fourth = int(turns) & 3
    sine = (s, c, 0.0 - s, 0.0 - c)[fourth]
    cosine = (c, 0.0 - s, 0.0 - c, s)[fourth]
    return x if abs(x) < _SMALLEST else sine, cosine


def sine_cosine(x: npt.ArrayLike) -> tuple[Floats, Floats]:
    """Sine and cosine of ``x`` [rad], any shape, in little more time than one of them."""
    if np.size(x) == 1:
        angle = np.asarray(x, np.float64)
        values = np.array(_sine_cosine_of_one(angle.item())).reshape((2, *angle.shape))
        return values[0, ...], values[1, ...]
    angles, known = _angles(x)
    s, c, fourth = _parts(angles)
    sines = np.choose(fourth, [s, c, 0.0 - s, 0.0 - c])
    sines = np.where(np.abs(angles) < _SMALLEST, angles, sines)
    cosines = np.choose(fourth, [c, 0.0 - s, 0.0 - c, s])
    return np.where(known, sines, np.nan), np.where(known, cosines, np.nan)


def sine(x: npt.ArrayLike) -> Floats:
    """Sine of ``x`` [rad], any shape; the bits of ``portable_sin``."""
    return sine_cosine(x)[0]


def cosine(x: npt.ArrayLike) -> Floats:
    """Cosine of ``x`` [rad], any shape; the bits of ``portable_cos``."""
    return sine_cosine(x)[1]


def tangent(x: npt.ArrayLike) -> Floats:
    """Tangent of ``x`` [rad], any shape; the bits of ``portable_tan``."""
    angles, known = _angles(x)
    s, c, fourth = _parts(angles)
    odd = (fourth & 1) == 1
    value = np.where(odd, 0.0 - c, s) / np.where(odd, s, c)
    value = np.where(np.abs(angles) < _SMALLEST, angles, value)
    return np.where(known, value, np.nan)


def angle_of(y: npt.ArrayLike, x: npt.ArrayLike) -> Floats:
    """Angle of the points (x, y) from the x axis [rad], any shape; the bits of ``portable_atan2``.

    For magnitudes of 0 or from 2**-400 to 2**400.
    """
    up, across = (np.asarray(v, np.float64) for v in np.broadcast_arrays(y, x))
    height, width, back = np.abs(up), np.abs(across), np.signbit(across)
    with np.errstate(all="ignore"):
        value = _half_plane(height, width, back)
        straight = ~back & (height < _SHORT * width)
        value = np.where(straight, height / width, value)
    pi = _constant("PI_0")
    diagonal = np.where(back, _constant("THREE_QUARTERS_PI_0"), _constant("QUARTER_PI_0"))
    value = np.where(height == width, diagonal, value)
    value = np.where(height == 0.0, np.where(back, pi, 0.0), value)
    return np.copysign(value, up)


def sine_share(x: npt.ArrayLike) -> Floats:
    """``sin(x) / x``, 1 at 0, any shape."""
    angles = np.asarray(x, np.float64)
    known = np.where(angles == 0.0, 1.0, angles)
    return np.where(angles == 0.0, 1.0, sine(known) / known)


def _half_plane(height: Floats, width: Floats, back: Any) -> Floats:
    """Angles of points with positive coordinates, of (-width, height) where ``back``."""
    flat = height <= _constant("TAN_PI_8") * width
    steep = ~flat & (width <= _constant("TAN_PI_8") * height)
    difference, difference_rest = _exact_sum(height, -width)
    total, total_rest = _exact_sum(height, width)
    a = np.where(flat, height, np.where(steep, 0.0 - width, difference))
    a_rest = np.where(flat | steep, 0.0, difference_rest)
    b = np.where(flat, width, np.where(steep, height, total))
    b_rest = np.where(flat | steep, 0.0, total_rest)
    inverse = 1.0 / b
    u = a * inverse
    product, product_rest = _exact_product(u, b)
    rest = (((a - product) - product_rest) + (a_rest - u * b_rest)) * inverse
    base = _choice(flat, steep, back, 0)
    base_rest = _choice(flat, steep, back, 1)
    u, rest = np.where(back, 0.0 - u, u), np.where(back, 0.0 - rest, rest)
    z = u * u
    most, lost = _exact_sum(base, u)
    return most + (lost + (base_rest + rest * (1.0 - z) + u * z * _series(z, "ATAN", 11)))


def _choice(flat: Any, steep: Any, back: Any, part: int) -> Floats:
    """The angle that is nearest, a multiple of 45 degrees, its first or second part."""
    quarter, half, three, pi = (
        _constant(f"{name}_{part}") for name in ("QUARTER_PI", "HALF_PI", "THREE_QUARTERS_PI", "PI")
    )
    diagonal = np.where(back, three, quarter)
    return np.where(flat, np.where(back, pi, 0.0), np.where(steep, half, diagonal))
