"""Portable inverse tangent, sine and cosine.

The angle of a point is an angle of 0, 45 or 90 degrees plus the inverse tangent of a quotient ``u``
of at most tan(pi/8). The remainder of that division is taken into account, so the error is mostly
that of the last sum.
"""

import warp as wp

from twin.base.portable import constants as c
from twin.base.portable.exact import (
    exact_product,
    exact_sum,
    is_negative,
    magnitude,
    not_a_number,
    opposite,
    ordered_sum,
)

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_LARGE = wp.constant(wp.float64(2.0**400))
_SMALL = wp.constant(wp.float64(2.0**-400))
_GROWTH = wp.constant(wp.float64(2.0**600))
_SHRINKAGE = wp.constant(wp.float64(2.0**-600))
_SHORT = wp.constant(wp.float64(2.0**-30))


@wp.func
def _with_sign_of(value: wp.float64, sign: wp.float64) -> wp.float64:
    if is_negative(sign):
        return opposite(value)
    return value


@wp.func
def _arc(base: wp.float64, base_rest: wp.float64, u: wp.float64, u_rest: wp.float64) -> wp.float64:
    """``base + atan(u + u_rest)`` with ``base`` in two parts and ``u`` of at most tan(pi/8)."""
    z = u * u
    tail = c.ATAN_7 + z * (c.ATAN_8 + z * (c.ATAN_9 + z * (c.ATAN_10 + z * c.ATAN_11)))
    middle = c.ATAN_3 + z * (c.ATAN_4 + z * (c.ATAN_5 + z * (c.ATAN_6 + z * tail)))
    series = c.ATAN_0 + z * (c.ATAN_1 + z * (c.ATAN_2 + z * middle))
    most, lost = exact_sum(base, u)
    return most + (lost + (base_rest + u_rest * (_ONE - z) + u * z * series))


@wp.func
def _quotient(a: wp.float64, a_rest: wp.float64, b: wp.float64, b_rest: wp.float64):
    """``(a + a_rest) / (b + b_rest)`` in two parts; one division is enough for both."""
    inverse = _ONE / b
    u = a * inverse
    product, product_rest = exact_product(u, b)
    return u, (((a - product) - product_rest) + (a_rest - u * b_rest)) * inverse


@wp.func
def _half_plane_angle(
    y: wp.float64, y_rest: wp.float64, x: wp.float64, x_rest: wp.float64, back: bool
) -> wp.float64:
    """Angle [rad] of the point (x, y) for positive ``y`` and ``x``; of (-x, y) if ``back``.

    Both are sums of two parts. The larger of them is between 2**-400 and 2**400.
    """
    base = _ZERO
    base_rest = _ZERO
    u = _ZERO
    u_rest = _ZERO
    if y <= c.TAN_PI_8 * x:
        u, u_rest = _quotient(y, y_rest, x, x_rest)
        if back:
            base = c.PI_0
            base_rest = c.PI_1
    elif x <= c.TAN_PI_8 * y:
        u, u_rest = _quotient(-x, -x_rest, y, y_rest)
        base = c.HALF_PI_0
        base_rest = c.HALF_PI_1
    else:
        difference, difference_rest = exact_sum(y, -x)
        total, total_rest = exact_sum(y, x)
        u, u_rest = _quotient(
            difference, difference_rest + (y_rest - x_rest), total, total_rest + (y_rest + x_rest)
        )
        base = c.QUARTER_PI_0
        base_rest = c.QUARTER_PI_1
        if back:
            base = c.THREE_QUARTERS_PI_0
            base_rest = c.THREE_QUARTERS_PI_1
    if back:
        return _arc(base, base_rest, -u, -u_rest)
    return _arc(base, base_rest, u, u_rest)


@wp.func
def portable_atan2(y: wp.float64, x: wp.float64) -> wp.float64:
    """Angle of the point (x, y) from the x axis, from -pi to pi [rad].

    Signed zeros and infinities are those of IEEE 754: ``atan2(-0.0, -1.0)`` is -pi,
    ``atan2(0.0, 0.0)`` is 0.0, ``atan2(inf, -inf)`` is 3/4 pi. NaN where an argument is NaN.
    """
    if x != x or y != y:
        return not_a_number()
    height = magnitude(y)
    width = magnitude(x)
    back = is_negative(x)
    if height == _ZERO:
        if back:
            return _with_sign_of(c.PI_0, y)
        return y
    if height == width:  # also where both are infinite
        if back:
            return _with_sign_of(c.THREE_QUARTERS_PI_0, y)
        return _with_sign_of(c.QUARTER_PI_0, y)
    if not back and height < _SHORT * width:  # before scaling could make it zero
        return _with_sign_of(height / width, y)
    larger = wp.max(height, width)
    if larger > _LARGE:  # an infinite one stays so
        height = height * _SHRINKAGE
        width = width * _SHRINKAGE
    if larger < _SMALL:
        height = height * _GROWTH
        width = width * _GROWTH
    if larger - larger != _ZERO:
        if width > height:  # and back
            return _with_sign_of(c.PI_0, y)
        return _with_sign_of(c.HALF_PI_0, y)
    return _with_sign_of(_half_plane_angle(height, _ZERO, width, _ZERO, back), y)


@wp.func
def portable_atan(x: wp.float64) -> wp.float64:
    """Inverse tangent, from -pi/2 to pi/2 [rad]; of -0.0 it is -0.0, of infinities ±pi/2."""
    return portable_atan2(x, _ONE)


@wp.func
def _other_leg(x: wp.float64):
    """``sqrt(1 - x * x)`` in two parts, for magnitudes below 1."""
    square, square_rest = exact_product(x, x)
    most, lost = ordered_sum(_ONE, -square)
    lost = lost - square_rest
    leg = wp.sqrt(most + lost)
    product, product_rest = exact_product(leg, leg)
    return leg, (((most - product) - product_rest) + lost) / (_TWO * leg)


@wp.func
def portable_asin(x: wp.float64) -> wp.float64:
    """Inverse sine, from -pi/2 to pi/2 [rad]; NaN outside -1 to 1, -0.0 of -0.0."""
    if not (wp.abs(x) <= _ONE):
        return not_a_number()
    if wp.abs(x) < _SHORT:  # the cubic term is below half of the last bit
        return x
    if wp.abs(x) == _ONE:
        return _with_sign_of(c.HALF_PI_0, x)
    leg, leg_rest = _other_leg(x)
    return _with_sign_of(_half_plane_angle(wp.abs(x), _ZERO, leg, leg_rest, False), x)


@wp.func
def portable_acos(x: wp.float64) -> wp.float64:
    """Inverse cosine, from 0 to pi [rad]; NaN outside -1 to 1."""
    if not (wp.abs(x) <= _ONE):
        return not_a_number()
    if x == _ONE:
        return _ZERO
    if x == -_ONE:
        return c.PI_0
    if wp.abs(x) < _SHORT:
        return c.HALF_PI_0 - (x - c.HALF_PI_1)
    leg, leg_rest = _other_leg(x)
    return _half_plane_angle(leg, leg_rest, wp.abs(x), _ZERO, is_negative(x))
