"""Transcendental functions for Warp kernels with the same bits on CPU and CUDA.

Libraries' sines differ in their last bits from processor to processor. These functions use
comparisons, conversions, copies of bits, ``+ - * /``, ``sqrt`` and ``floor``, which IEEE 754
defines to the last bit, in a fixed order. One condition is the caller's: Warp compiles a function
into the module of the kernel that calls it, and by default compilers fuse a product and a sum,
which changes bits. **Every module with a kernel that calls these functions says**::

    wp.set_module_options({"fuse_fp": False})

================================== ============================ ==============
function                           range                        largest error
================================== ============================ ==============
``portable_sin``, ``portable_cos`` magnitudes up to 1.6e6 rad   1 ulp
``portable_turn``                  the same                     the same
``portable_tan``                   magnitudes up to 1.6e6 rad   2 ulp
``portable_atan``, ``_atan2``      all                          1 ulp
``portable_asin``, ``_acos``       -1 to 1                      1 ulp
``portable_exp``, ``portable_log`` all                          1 ulp
``portable_pow``                   all                          1 ulp
``portable_tanh``                  all                          2 ulp
``portable_hypot``                 all                          2 ulp
``portable_exp_f32``               all                          1 ulp
================================== ============================ ==============

Beyond 1.6e6 rad the absolute error of sine and cosine grows to ``abs(x) * 2**-52``, and beyond
``ANGLE_LIMIT_RAD`` (2**40) they are NaN. Every NaN is the same one. An ulp is the distance between
neighbouring float64 at the exact value; subnormal results are within 1 ulp of their own, wider
spacing. Other functions that end in ``_f32`` compute in float64 and round to float32 once.

``wp.min`` and ``wp.max`` of 0.0 and -0.0 are the first of them on a CPU and the lower or higher one
on a GPU: add 0.0 to a result that may be either. ``wp.NAN`` has other bits on a GPU, too.

Coefficients are our own: ``tests/kernel/portable_coefficients.py`` derives them.
"""

import warp as wp

from twin.base.portable.arcs import portable_acos, portable_asin, portable_atan, portable_atan2
from twin.base.portable.circle import (
    ANGLE_LIMIT_RAD,
    portable_cos,
    portable_sin,
    portable_tan,
    portable_turn,
)
from twin.base.portable.growth import (
    portable_exp,
    portable_hypot,
    portable_log,
    portable_pow,
    portable_tanh,
)
from twin.base.portable.short import portable_exp_f32

__all__ = [
    "ANGLE_LIMIT_RAD",
    "portable_acos",
    "portable_asin",
    "portable_asin_f32",
    "portable_atan",
    "portable_atan2",
    "portable_atan2_f32",
    "portable_cos",
    "portable_cos_f32",
    "portable_exp",
    "portable_exp_f32",
    "portable_hypot",
    "portable_log",
    "portable_log_f32",
    "portable_pow",
    "portable_pow_f32",
    "portable_sin",
    "portable_sin_f32",
    "portable_tan",
    "portable_tanh",
    "portable_turn",
]


@wp.func
def portable_sin_f32(x: wp.float32) -> wp.float32:
    """Sine of ``x`` [rad] in float32."""
    return wp.float32(portable_sin(wp.float64(x)))


@wp.func
def portable_cos_f32(x: wp.float32) -> wp.float32:
    """Cosine of ``x`` [rad] in float32."""
    return wp.float32(portable_cos(wp.float64(x)))


@wp.func
def portable_asin_f32(x: wp.float32) -> wp.float32:
    """Inverse sine [rad] in float32."""
    return wp.float32(portable_asin(wp.float64(x)))


@wp.func
def portable_atan2_f32(y: wp.float32, x: wp.float32) -> wp.float32:
    """Angle of the point (x, y) from the x axis [rad] in float32."""
    return wp.float32(portable_atan2(wp.float64(y), wp.float64(x)))


@wp.func
def portable_log_f32(x: wp.float32) -> wp.float32:
    """Natural logarithm in float32."""
    return wp.float32(portable_log(wp.float64(x)))


@wp.func
def portable_pow_f32(x: wp.float32, y: wp.float32) -> wp.float32:
    """``x**y`` in float32, with the special values of ``portable_pow``."""
    return wp.float32(portable_pow(wp.float64(x), wp.float64(y)))
