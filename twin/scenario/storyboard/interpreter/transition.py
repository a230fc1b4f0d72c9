"""Warp functions: transitions from one value to another (ASAM OpenSCENARIO XML 1.3, 7.4.1.4).

With x the part of the span that is over and d the change, the shapes are d x (linear),
d (3 x^2 - 2 x^3) (cubic: slope 0 at both ends) and d (1 - cos(pi x)) / 2 (sinusoidal). Their slopes
peak at d / span times 1, 3/2 and pi/2; the peak is what a rate means. Their second derivatives
peak at the ends, at 6 d / span^2 (cubic) and pi^2 d / (2 span^2) (sinusoidal), from which follows
the span of a lane offset with a largest lateral acceleration. The standard leaves it open for a
linear one, which gets that of the cubic as in esmini.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_cos, portable_sin
from twin.scenario.storyboard.program.actions import DynamicsShape

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

CLOSE = wp.constant(wp.float64(1e-6))
"""Differences that do not count, [s], [m] or [m/s]: a sum of steps and a literal agree."""
FAR = wp.constant(wp.float64(1e10))
ZERO = wp.constant(wp.float64(0.0))
ONE = wp.constant(wp.float64(1.0))
TWO = wp.constant(wp.float64(2.0))
HALF = wp.constant(wp.float64(0.5))
THREE = wp.constant(wp.float64(3.0))
FOUR = wp.constant(wp.float64(4.0))
SIX = wp.constant(wp.float64(6.0))
PI = wp.constant(wp.float64(3.141592653589793))
_PEAK_CUBIC = wp.constant(wp.float64(1.5))


@wp.func
def sign_of(value: wp.float64) -> wp.float64:
    """-1 of negative values, else 1."""
    return wp.where(value < ZERO, -ONE, ONE)


@wp.func
def not_zero(value: wp.float64) -> wp.float64:
    """The value, or the smallest that counts with its sign."""
    return wp.where(wp.abs(value) < CLOSE, sign_of(value) * CLOSE, value)


@wp.func
def slope_peak(shape: wp.int32) -> wp.float64:
    """Largest slope of a shape over that of a line."""
    if shape == DynamicsShape.CUBIC:
        return _PEAK_CUBIC
    if shape == DynamicsShape.SINUSOIDAL:
        return HALF * PI
    return ONE


@wp.func
def span_by_rate(shape: wp.int32, change: wp.float64, rate: wp.float64) -> wp.float64:
    """How long a change takes whose slope peaks at a rate, at least ``CLOSE``."""
    if shape == DynamicsShape.STEP:
        return CLOSE
    return wp.max(slope_peak(shape) * wp.abs(change) / not_zero(wp.abs(rate)), CLOSE)


@wp.func
def span_by_bend(shape: wp.int32, change: wp.float64, bend: wp.float64) -> wp.float64:
    """How long a change takes whose second derivative peaks at ``bend``."""
    if shape == DynamicsShape.STEP:
        return ZERO
    if shape == DynamicsShape.SINUSOIDAL:
        return PI * wp.sqrt(wp.abs(change) / (TWO * bend))
    return wp.sqrt(SIX * wp.abs(change) / bend)


@wp.func
def value_at(
    shape: wp.int32, start: wp.float64, target: wp.float64, at: wp.float64, span: wp.float64
) -> wp.float64:
    """Value of a transition after ``at`` of its span; a span of nothing is a step."""
    if shape == DynamicsShape.STEP or span < CLOSE:
        return target
    part = at / span
    if shape == DynamicsShape.CUBIC:
        return start + (target - start) * part * part * (THREE - TWO * part)
    if shape == DynamicsShape.SINUSOIDAL:
        return start - (target - start) * (portable_cos(PI * part) - ONE) / TWO
    return start + part * (target - start)


@wp.func
def slope_at(
    shape: wp.int32, start: wp.float64, target: wp.float64, at: wp.float64, span: wp.float64
) -> wp.float64:
    """Slope of a transition after ``at`` of its span; of a step it is very large."""
    change = target - start
    if shape == DynamicsShape.STEP or span < CLOSE:
        return FAR * sign_of(change)
    if shape == DynamicsShape.CUBIC:
        return SIX * change * (span - at) * at / (span * span * span)
    if shape == DynamicsShape.SINUSOIDAL:
        return PI * change * portable_sin(PI * at / span) / (TWO * span)
    return change / span
