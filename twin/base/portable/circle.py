"""Portable sine, cosine and tangent.

An angle is reduced to ``r`` from -pi/4 to pi/4 by subtracting a multiple ``n`` of pi/2 in four
parts (Cody and Waite, "Software Manual for the Elementary Functions", 1980). The first three have
33 bits, so ``n`` times each of them is exact while ``n`` is at most 2**20. The remainder is a sum
of two floats.
"""

import warp as wp

from twin.base.portable import constants as c
from twin.base.portable.exact import exact_sum, not_a_number, ordered_sum

ANGLE_LIMIT_RAD = wp.constant(wp.float64(1099511627776.0))
"""2**40. Angles of a larger magnitude have no sine here: the functions return NaN."""

_HALF = wp.constant(wp.float64(0.5))
_ONE = wp.constant(wp.float64(1.0))
_TINY = wp.constant(wp.float64(1.0e-150))


@wp.func
def _quarter_turns(x: wp.float64) -> wp.float64:
    """The multiple of pi/2 that is nearest to ``x``, by its number."""
    return wp.floor(x * c.TWO_OVER_PI + _HALF)


@wp.func
def _remainder(x: wp.float64, turns: wp.float64):
    """``x - turns * pi/2`` in two parts."""
    first, first_rest = exact_sum(x, -(turns * c.HALF_PI_PART_0))
    second, second_rest = exact_sum(first, -(turns * c.HALF_PI_PART_1))
    third, third_rest = exact_sum(second, -(turns * c.HALF_PI_PART_2))
    rest = third_rest + (second_rest + first_rest) - turns * c.HALF_PI_PART_3
    return ordered_sum(third, rest)


@wp.func
def _short_sine(r: wp.float64, rest: wp.float64) -> wp.float64:
    """Sine of ``r + rest``, a sum of two parts from -pi/4 to pi/4."""
    z = r * r
    tail = c.SIN_4 + z * (c.SIN_5 + z * c.SIN_6)
    series = c.SIN_0 + z * (c.SIN_1 + z * (c.SIN_2 + z * (c.SIN_3 + z * tail)))
    return r + (rest * (_ONE - _HALF * z) + r * z * series)


@wp.func
def _short_cosine(r: wp.float64, rest: wp.float64) -> wp.float64:
    """Cosine of ``r + rest``, a sum of two parts from -pi/4 to pi/4."""
    z = r * r
    tail = c.COS_4 + z * (c.COS_5 + z * c.COS_6)
    series = c.COS_0 + z * (c.COS_1 + z * (c.COS_2 + z * (c.COS_3 + z * tail)))
    most, lost = ordered_sum(_ONE, -(_HALF * z))
    return most + (lost + (z * z * series - r * rest))


@wp.func
def _fourth(turns: wp.float64) -> wp.int64:
    """``turns`` modulo 4, from 0 to 3."""
    return wp.int64(turns) & wp.int64(3)


@wp.func
def portable_sin(x: wp.float64) -> wp.float64:
    """Sine of ``x`` [rad]; see ``twin.base.portable_math`` for the accuracy.

    The sine of -0.0 is -0.0; of infinities, NaN and angles beyond ``ANGLE_LIMIT_RAD`` it is NaN.
    """
    if not (wp.abs(x) <= ANGLE_LIMIT_RAD):
        return not_a_number()
    if wp.abs(x) < _TINY:
        return x
    turns = _quarter_turns(x)
    r, rest = _remainder(x, turns)
    fourth = _fourth(turns)
    if fourth == wp.int64(0):
        return _short_sine(r, rest)
    if fourth == wp.int64(1):
        return _short_cosine(r, rest)
    if fourth == wp.int64(2):
        return -_short_sine(r, rest)
    return -_short_cosine(r, rest)


@wp.func
def portable_cos(x: wp.float64) -> wp.float64:
    """Cosine of ``x`` [rad]; see ``twin.base.portable_math`` for the accuracy.

    The cosine of infinities, NaN and angles beyond ``ANGLE_LIMIT_RAD`` is NaN.
    """
    if not (wp.abs(x) <= ANGLE_LIMIT_RAD):
        return not_a_number()
    turns = _quarter_turns(x)
    r, rest = _remainder(x, turns)
    fourth = _fourth(turns)
    if fourth == wp.int64(0):
        return _short_cosine(r, rest)
    if fourth == wp.int64(1):
        return -_short_sine(r, rest)
    if fourth == wp.int64(2):
        return -_short_cosine(r, rest)
    return _short_sine(r, rest)


@wp.func
def portable_turn(x: wp.float64) -> wp.vec2d:
    """Cosine and sine of ``x`` [rad]: those of :func:`portable_cos` and :func:`portable_sin`, in
    little more time than one of them."""
    if not (wp.abs(x) <= ANGLE_LIMIT_RAD):
        return wp.vec2d(not_a_number(), not_a_number())
    turns = _quarter_turns(x)
    r, rest = _remainder(x, turns)
    sine = _short_sine(r, rest)
    cosine = _short_cosine(r, rest)
    if wp.abs(x) < _TINY:
        sine = x
    fourth = _fourth(turns)
    if fourth == wp.int64(1):
        return wp.vec2d(-sine, cosine)
    if fourth == wp.int64(2):
        return wp.vec2d(-cosine, -sine)
    if fourth == wp.int64(3):
        return wp.vec2d(sine, -cosine)
    return wp.vec2d(cosine, sine)


@wp.func
def portable_tan(x: wp.float64) -> wp.float64:
    """Tangent of ``x`` [rad], as the quotient of sine and cosine.

    The tangent of -0.0 is -0.0; of infinities, NaN and angles beyond ``ANGLE_LIMIT_RAD`` it is NaN.
    """
    if not (wp.abs(x) <= ANGLE_LIMIT_RAD):
        return not_a_number()
    if wp.abs(x) < _TINY:
        return x
    turns = _quarter_turns(x)
    r, rest = _remainder(x, turns)
    sine = _short_sine(r, rest)
    cosine = _short_cosine(r, rest)
    if (_fourth(turns) & wp.int64(1)) == wp.int64(0):
        return sine / cosine
    return -cosine / sine
