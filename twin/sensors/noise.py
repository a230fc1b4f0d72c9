"""Random errors of sensors, in kernels: Gaussian numbers by counter, and biases that wander.

A number depends on (stream key, case tick, element) alone; a bias is its own last value and such a
number, so it depends on the case's ticks in their order and on nothing else.
"""

from __future__ import annotations

import math

import warp as wp

from twin.base.portable_math import portable_cos, portable_log
from twin.render.noise import draw

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_S32 = wp.constant(wp.uint64(32))
_LOW = wp.constant(wp.uint64(0xFFFFFFFF))
_UNIT = wp.constant(wp.float64(2.0**-32))
_HALF = wp.constant(wp.float64(0.5))
_TWO_PI = wp.constant(wp.float64(2.0 * math.pi))

GAUSS_MARKOV_PEAK = 0.61737
"""Highest Allan deviation of a Gauss-Markov process over its standard deviation [-]."""

GAUSS_MARKOV_PEAK_AT = 1.8926
"""Averaging time of that highest point over the correlation time [-]."""


@wp.func
def gaussian(key: wp.uint64, tick: wp.int32, element: wp.int32) -> wp.float64:
    """Normal number, mean 0, variance 1, up to 6.7 sigma (Box and Muller 1958)."""
    bits = draw(key, tick, element)
    u = (wp.float64(bits >> _S32) + _HALF) * _UNIT
    v = wp.float64(bits & _LOW) * _UNIT
    return wp.sqrt(wp.float64(-2.0) * portable_log(u)) * portable_cos(_TWO_PI * v)


@wp.func
def uniform(key: wp.uint64, tick: wp.int32, element: wp.int32) -> wp.float64:
    """Uniform number in (0, 1)."""
    return (wp.float64(draw(key, tick, element) >> _S32) + _HALF) * _UNIT


@wp.struct
class Wander:
    """A first-order Gauss-Markov process of variance 1, sampled at a fixed period."""

    keep: wp.float64
    """Share of the last value that is left, e^(-dt/T) [-]."""
    drive: wp.float64
    """Amplitude of what is new, sqrt(1 - keep^2) [-]."""


@wp.func
def wander(
    process: Wander, last: wp.float64, key: wp.uint64, tick: wp.int32, element: wp.int32
) -> wp.float64:
    """Next value; at tick 0 one of the process's long-term distribution."""
    fresh = gaussian(key, tick, element)
    if tick == 0:
        return fresh
    return process.keep * last + process.drive * fresh


def wander_numbers(period_s: float, time_s: float) -> tuple[float, float]:
    """``keep`` and ``drive`` of a process of correlation time ``time_s``, every ``period_s``."""
    return math.exp(-period_s / time_s), math.sqrt(-math.expm1(-2.0 * period_s / time_s))
