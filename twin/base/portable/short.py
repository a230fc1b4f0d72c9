"""Portable functions that compute in float32, for kernels that call them for every pixel or ray."""

import warp as wp

from twin.base.portable import coefficients as c
from twin.base.portable.exact import infinity_f32, not_a_number_f32

_EXP_MAX = wp.constant(wp.float32(89.0))
_EXP_MIN = wp.constant(wp.float32(-104.0))
_ZERO = wp.constant(wp.float32(0.0))
_HALF = wp.constant(wp.float32(0.5))
_ONE = wp.constant(wp.float32(1.0))
_ONE_OVER_LN2 = wp.constant(wp.float32(c.ONE_OVER_LN2))
_LN2_0, _LN2_1 = (wp.constant(wp.float32(v)) for v in (c.LN2_SHORT_0, c.LN2_SHORT_1))
_EXP_0, _EXP_1 = (wp.constant(wp.float32(v)) for v in (c.EXP_SHORT_0, c.EXP_SHORT_1))
_EXP_2, _EXP_3 = (wp.constant(wp.float32(v)) for v in (c.EXP_SHORT_2, c.EXP_SHORT_3))
_EXP_4, _EXP_5 = (wp.constant(wp.float32(v)) for v in (c.EXP_SHORT_4, c.EXP_SHORT_5))
_BIAS = wp.constant(wp.int32(127))
_MANTISSA_BITS = wp.constant(wp.int32(23))


@wp.func
def _power_of_two(exponent: wp.int32) -> wp.float32:
    """``2**exponent`` for exponents from -126 to 127."""
    return wp.cast((exponent + _BIAS) << _MANTISSA_BITS, wp.float32)


@wp.func
def portable_exp_f32(x: wp.float32) -> wp.float32:
    """Exponential: infinite above 88.73, subnormal below -87.3, 0.0 below -104; NaN of NaN."""
    if x != x:
        return not_a_number_f32()
    if x > _EXP_MAX:
        return infinity_f32()
    if x < _EXP_MIN:
        return _ZERO
    k = wp.floor(x * _ONE_OVER_LN2 + _HALF)
    r = (x - k * _LN2_0) - k * _LN2_1
    series = _EXP_0 + r * (_EXP_1 + r * (_EXP_2 + r * (_EXP_3 + r * (_EXP_4 + r * _EXP_5))))
    power = wp.int32(k)
    half = power >> 1
    return (_ONE + (r + r * r * series)) * _power_of_two(half) * _power_of_two(power - half)
