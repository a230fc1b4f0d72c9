"""Sums and products without loss, and powers of two, for the portable functions.

A value that needs more than 53 bits is an unevaluated sum of two float64, the larger first. The sum
and product of two float64 are exact in that form (Dekker, "A floating-point technique for extending
the available precision", 1971; Knuth, "The Art of Computer Programming", volume 2, section 4.2.2),
provided that no step is fused or reordered. Products are exact for magnitudes from 2**-450 to
2**450.
"""

import warp as wp

_SPLITTER = wp.constant(wp.float64(134217729.0))  # 2**27 + 1
_EXPONENT_BIAS = wp.constant(wp.int64(1023))
_MANTISSA_BITS = wp.constant(wp.int64(52))
_EXPONENT_MASK = wp.constant(wp.int64(0x7FF))
_MANTISSA_MASK = wp.constant(wp.int64(0xFFFFFFFFFFFFF))
_ONE_BITS = wp.constant(wp.int64(0x3FF0000000000000))
_ALL_BUT_SIGN = wp.constant(wp.int64(0x7FFFFFFFFFFFFFFF))
_NAN_BITS = wp.constant(wp.int64(0x7FF8000000000000))
_NAN_BITS_F32 = wp.constant(wp.int32(0x7FC00000))
_INFINITY_BITS_F32 = wp.constant(wp.int32(0x7F800000))
_INFINITY_BITS = wp.constant(wp.int64(0x7FF0000000000000))


@wp.func
def not_a_number() -> wp.float64:
    """The one NaN of the portable functions; processors make NaNs of different bits."""
    return wp.cast(_NAN_BITS, wp.float64)


@wp.func
def infinity() -> wp.float64:
    """Positive infinity."""
    return wp.cast(_INFINITY_BITS, wp.float64)


@wp.func
def not_a_number_f32() -> wp.float32:
    """The one NaN in float32; ``wp.NAN`` has other bits on a GPU."""
    return wp.cast(_NAN_BITS_F32, wp.float32)


@wp.func
def infinity_f32() -> wp.float32:
    """Positive infinity in float32."""
    return wp.cast(_INFINITY_BITS_F32, wp.float32)


@wp.func
def is_negative(x: wp.float64) -> bool:
    """Whether the sign bit of ``x`` is set, as it is for -0.0."""
    return wp.cast(x, wp.int64) < wp.int64(0)


@wp.func
def magnitude(x: wp.float64) -> wp.float64:
    """``x`` without its sign bit."""
    return wp.cast(wp.cast(x, wp.int64) & _ALL_BUT_SIGN, wp.float64)


@wp.func
def opposite(x: wp.float64) -> wp.float64:
    """``x`` with the other sign, also of zeros: ``-x`` is ``0 - x`` in kernels, never -0.0."""
    return wp.cast(wp.cast(x, wp.int64) ^ ~_ALL_BUT_SIGN, wp.float64)


@wp.func
def power_of_two(exponent: wp.int64) -> wp.float64:
    """``2**exponent`` for exponents from -1022 to 1023."""
    return wp.cast((exponent + _EXPONENT_BIAS) << _MANTISSA_BITS, wp.float64)


@wp.func
def scaled(x: wp.float64, exponent: wp.int64) -> wp.float64:
    """``x * 2**exponent`` for ``x`` of magnitude 0.2 to 16, rounded once.

    Exponents are from -2000 to 2000; results overflow to infinity and underflow to zero.
    """
    half = exponent >> wp.int64(1)
    return x * power_of_two(half) * power_of_two(exponent - half)


@wp.func
def exponent_of(x: wp.float64) -> wp.int64:
    """Exponent ``e`` of a positive normal ``x = m * 2**e`` with ``m`` from 1 to below 2."""
    bits = wp.cast(x, wp.int64)
    return ((bits >> _MANTISSA_BITS) & _EXPONENT_MASK) - _EXPONENT_BIAS


@wp.func
def mantissa_of(x: wp.float64) -> wp.float64:
    """Mantissa ``m`` of a positive normal ``x = m * 2**e``, from 1 to below 2."""
    return wp.cast((wp.cast(x, wp.int64) & _MANTISSA_MASK) | _ONE_BITS, wp.float64)


@wp.func
def ordered_sum(a: wp.float64, b: wp.float64):
    """``a + b`` in two parts, exact if ``a`` is zero or not smaller than ``b`` in magnitude."""
    total = a + b
    return total, b - (total - a)


@wp.func
def exact_sum(a: wp.float64, b: wp.float64):
    """``a + b`` in two parts, exact."""
    total = a + b
    b_share = total - a
    a_share = total - b_share
    return total, (a - a_share) + (b - b_share)


@wp.func
def exact_product(a: wp.float64, b: wp.float64):
    """``a * b`` in two parts, exact."""
    product = a * b
    a_spread = a * _SPLITTER
    a_high = a_spread - (a_spread - a)
    a_low = a - a_high
    b_spread = b * _SPLITTER
    b_high = b_spread - (b_spread - b)
    b_low = b - b_high
    rest = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return product, rest


@wp.func
def pair_product(a: wp.float64, a_rest: wp.float64, b: wp.float64, b_rest: wp.float64):
    """Product of two sums of two parts, in two parts; relative error below 2**-100."""
    product, rest = exact_product(a, b)
    return ordered_sum(product, rest + (a * b_rest + a_rest * b))
