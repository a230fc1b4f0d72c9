"""Portable exponential, logarithm, power, hyperbolic tangent and hypotenuse.

The exponential is ``2**k`` times that of a remainder from -log(2)/2 to log(2)/2. The logarithm of
``m * 2**e`` with ``m`` from sqrt(1/2) to sqrt(2) is ``e * log(2)`` plus the series of the inverse
hyperbolic tangent in ``s = (m - 1) / (m + 1)``. A power needs a logarithm with 11 bits more than a
float has, so there the first two terms are sums of two floats.
"""

import warp as wp

from twin.base.portable import constants as c
from twin.base.portable.exact import (
    exact_product,
    exact_sum,
    exponent_of,
    infinity,
    is_negative,
    magnitude,
    mantissa_of,
    not_a_number,
    opposite,
    ordered_sum,
    pair_product,
    scaled,
)

_ZERO = wp.constant(wp.float64(0.0))
_SHORT = wp.constant(wp.float64(2.0**-30))
_QUARTER = wp.constant(wp.float64(0.25))
_HALF = wp.constant(wp.float64(0.5))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_ROOT_TWO = wp.constant(wp.float64(1.4142135623730951))
_SMALLEST_NORMAL = wp.constant(wp.float64(2.0**-1022))
_SUBNORMAL_GROWTH = wp.constant(wp.float64(2.0**54))
_SUBNORMAL_EXPONENT = wp.constant(wp.int64(54))
_LARGE = wp.constant(wp.float64(2.0**500))
_SMALL = wp.constant(wp.float64(2.0**-500))
_GROWTH = wp.constant(wp.float64(2.0**600))
_SHRINKAGE = wp.constant(wp.float64(2.0**-600))
_EXP_MAX = wp.constant(wp.float64(710.0))
_EXP_MIN = wp.constant(wp.float64(-746.0))
_TANH_FLAT = wp.constant(wp.float64(22.0))
_SCALE_MAX = wp.constant(wp.int64(2000))
_INTEGER_POWER_MAX = wp.constant(wp.float64(64.0))
_ALL_EVEN = wp.constant(wp.float64(9007199254740992.0))  # 2**53: larger floats are even


@wp.func
def _exp_parts(x: wp.float64, x_rest: wp.float64):
    """Exponential of a sum of two parts from -746 to 710: a sum of two parts and ``k`` of 2**k."""
    k = wp.floor(x * c.ONE_OVER_LN2 + _HALF)
    r, r_rest = exact_sum(x - k * c.LN2_PART_0, -(k * c.LN2_PART_1))
    r_rest = r_rest + x_rest
    tail = c.EXP_7 + r * (c.EXP_8 + r * (c.EXP_9 + r * (c.EXP_10 + r * c.EXP_11)))
    middle = c.EXP_3 + r * (c.EXP_4 + r * (c.EXP_5 + r * (c.EXP_6 + r * tail)))
    series = c.EXP_0 + r * (c.EXP_1 + r * (c.EXP_2 + r * middle))
    curve = r * r * series
    most, lost = ordered_sum(_ONE, r)
    return most, lost + (curve + r_rest * (_ONE + (r + curve))), wp.int64(k)


@wp.func
def _exp_of_pair(x: wp.float64, x_rest: wp.float64) -> wp.float64:
    """Exponential of a sum of two parts, the second of which is far below 1."""
    if x > _EXP_MAX:
        return infinity()
    if x < _EXP_MIN:
        return _ZERO
    most, lost, k = _exp_parts(x, x_rest)
    return scaled(most + lost, k)


@wp.func
def portable_exp(x: wp.float64) -> wp.float64:
    """Exponential: infinite above 709.79, subnormal below -708.4, 0.0 below -745.14; NaN of NaN."""
    if x != x:
        return not_a_number()
    return _exp_of_pair(x, _ZERO)


@wp.func
def _binary_parts(x: wp.float64):
    """``m`` from sqrt(1/2) to sqrt(2) and ``e`` of a positive finite ``x = m * 2**e``."""
    e = wp.int64(0)
    normal = x
    if x < _SMALLEST_NORMAL:
        normal = x * _SUBNORMAL_GROWTH
        e = -_SUBNORMAL_EXPONENT
    e = e + exponent_of(normal)
    m = mantissa_of(normal)
    if m > _ROOT_TWO:
        m = m * _HALF
        e = e + wp.int64(1)
    return m, e


@wp.func
def portable_log(x: wp.float64) -> wp.float64:
    """Natural logarithm: minus infinity of ±0.0, NaN of negative numbers and NaN."""
    if x == _ZERO:
        return -infinity()
    if not (x > _ZERO):
        return not_a_number()
    if x == infinity():
        return x
    m, e = _binary_parts(x)
    f = m - _ONE
    s = f / (_TWO + f)
    z = s * s
    tail = c.LOG_4 + z * (c.LOG_5 + z * (c.LOG_6 + z * c.LOG_7))
    series = c.LOG_0 + z * (c.LOG_1 + z * (c.LOG_2 + z * (c.LOG_3 + z * tail)))
    exponent = wp.float64(e)
    # 2 s is f - s f, whose first term is exact.
    most, lost = ordered_sum(exponent * c.LN2_PART_0, f)
    return most + (lost + (exponent * c.LN2_PART_1 - s * (f - z * series)))


@wp.func
def _log_pair(m: wp.float64, exponent: wp.float64):
    """Logarithm of ``m * 2**exponent`` in two parts; absolute error below 2**-64 times its size."""
    f = m - _ONE
    divisor, divisor_rest = ordered_sum(_TWO, f)
    s = f / divisor
    product, product_rest = exact_product(s, divisor)
    s_rest = (((f - product) - product_rest) - s * divisor_rest) / divisor
    z, z_rest = pair_product(s, s_rest, s, s_rest)
    cube, cube_rest = pair_product(s, s_rest, z, z_rest)
    term, term_rest = pair_product(cube, cube_rest, c.TWO_THIRDS_0, c.TWO_THIRDS_1)
    tail = c.LOG_TAIL_4 + z * (c.LOG_TAIL_5 + z * (c.LOG_TAIL_6 + z * c.LOG_TAIL_7))
    series = c.LOG_TAIL_1 + z * (c.LOG_TAIL_2 + z * (c.LOG_TAIL_3 + z * tail))
    short = cube * z * (c.LOG_TAIL_0 + z * series)
    short_sum, short_lost = exact_sum(term, short)
    log_m, log_m_lost = exact_sum(_TWO * s, short_sum)
    log_rest = log_m_lost + (short_lost + term_rest + _TWO * s_rest)
    most, lost = exact_sum(exponent * c.LN2_PART_0, log_m)
    return ordered_sum(most, lost + (exponent * c.LN2_PART_1 + log_rest))


@wp.func
def _integer_power(x: wp.float64, y: wp.float64) -> wp.float64:
    """``x**y`` of a positive finite ``x`` and an integer from -64 to 64 by multiplication."""
    m, e = _binary_parts(x)
    left = wp.int64(wp.abs(y))
    square = m
    square_rest = _ZERO
    power = _ONE
    power_rest = _ZERO
    while left > wp.int64(0):
        if (left & wp.int64(1)) == wp.int64(1):
            power, power_rest = pair_product(power, power_rest, square, square_rest)
        square, square_rest = pair_product(square, square_rest, square, square_rest)
        left = left >> wp.int64(1)
    if y < _ZERO:
        inverse = _ONE / power
        product, product_rest = exact_product(inverse, power)
        short = (((_ONE - product) - product_rest) - inverse * power_rest) / power
        power, power_rest = ordered_sum(inverse, short)
    shift = exponent_of(power)
    exponent = wp.min(wp.max(shift + e * wp.int64(y), -_SCALE_MAX), _SCALE_MAX)
    return scaled(mantissa_of(power), exponent)


@wp.func
def _positive_power(x: wp.float64, y: wp.float64) -> wp.float64:
    """``x**y`` of a positive finite ``x`` and a finite ``y`` that is not zero."""
    if wp.abs(y) <= _INTEGER_POWER_MAX and y == wp.floor(y):
        return _integer_power(x, y)
    m, e = _binary_parts(x)
    log_x, log_x_rest = _log_pair(m, wp.float64(e))
    rough = y * log_x
    if rough > _EXP_MAX:
        return infinity()
    if rough < _EXP_MIN:
        return _ZERO
    if wp.abs(rough) < wp.float64(1.0e-20):
        return _ONE
    product, product_rest = exact_product(y, log_x)
    return _exp_of_pair(product, product_rest + y * log_x_rest)


@wp.func
def _zero_or_infinite_power(size: wp.float64, y: wp.float64) -> wp.float64:
    """``size**y`` where ``size`` is 0 or infinite, or ``y`` is infinite; ``size`` is not 1."""
    if (size > _ONE) == (y > _ZERO):
        return infinity()
    return _ZERO


@wp.func
def portable_pow(x: wp.float64, y: wp.float64) -> wp.float64:
    """``x**y`` with the special values of IEEE 754.

    Integers ``y`` from -64 to 64 are repeated multiplications with twice the digits: what a float
    can hold is exact. A negative ``x`` needs an integer ``y``, or the result is NaN. ``x**0.0`` and
    ``1.0**y`` are 1.0 also for NaN.
    """
    if y == _ZERO or x == _ONE:
        return _ONE
    if x != x or y != y:
        return not_a_number()
    size = magnitude(x)
    whole = y == wp.floor(y)
    odd = whole and wp.abs(y) < _ALL_EVEN and (wp.int64(y) & wp.int64(1)) == wp.int64(1)
    if size == _ONE and wp.abs(y) == infinity():
        return _ONE
    if size == _ZERO or size == infinity() or wp.abs(y) == infinity():
        power = _zero_or_infinite_power(size, y)
        if odd and is_negative(x):
            return opposite(power)
        return power
    if x > _ZERO:
        return _positive_power(x, y)
    if not whole:
        return not_a_number()
    if odd:
        return opposite(_positive_power(size, y))
    return _positive_power(size, y)


@wp.func
def portable_tanh(x: wp.float64) -> wp.float64:
    """Hyperbolic tangent: ±1.0 beyond 22, -0.0 of -0.0, NaN of NaN."""
    if x != x:
        return not_a_number()
    size = wp.abs(x)
    if size < _SHORT:  # the cubic term is below half of the last bit
        return x
    if size < _QUARTER:
        z = x * x
        tail = c.TANH_5 + z * (c.TANH_6 + z * (c.TANH_7 + z * c.TANH_8))
        series = c.TANH_1 + z * (c.TANH_2 + z * (c.TANH_3 + z * (c.TANH_4 + z * tail)))
        return x + x * (z * (c.TANH_0 + z * series))
    flat = _ONE
    if size < _TANH_FLAT:
        most, lost, k = _exp_parts(_TWO * size, _ZERO)
        square = scaled(most, k)
        square_rest = scaled(lost, k)
        above, above_rest = exact_sum(square, -_ONE)
        below, below_rest = exact_sum(square, _ONE)
        flat = (above + (above_rest + square_rest)) / (below + (below_rest + square_rest))
    if x < _ZERO:
        return opposite(flat)
    return flat


@wp.func
def portable_hypot(x: wp.float64, y: wp.float64) -> wp.float64:
    """``sqrt(x * x + y * y)`` without overflow on the way; infinite where an argument is."""
    larger = wp.max(magnitude(x), magnitude(y))
    smaller = wp.min(magnitude(x), magnitude(y))
    if magnitude(x) == infinity() or magnitude(y) == infinity():
        return infinity()
    if x != x or y != y:
        return not_a_number()
    if larger > _LARGE:
        larger = larger * _SHRINKAGE
        return wp.sqrt(larger * larger + smaller * _SHRINKAGE * (smaller * _SHRINKAGE)) * _GROWTH
    if larger < _SMALL:
        larger = larger * _GROWTH
        return wp.sqrt(larger * larger + smaller * _GROWTH * (smaller * _GROWTH)) * _SHRINKAGE
    return wp.sqrt(larger * larger + smaller * smaller)
