"""Tyre forces: the two-piece cubic friction curve and the friction ellipse for combined slip.

With s the slip over the extremum's, f(s) = F / F_e is (k - 2) s^3 + (3 - 2k) s^2 + k s up to the
extremum (slope k at the origin, 0 at s = 1), then the cubic that falls to the asymptote with slope
0 at both ends. Combined slip rho = sqrt(s_x^2 + s_y^2) enters both curves and each force takes its
share s_x / rho or s_y / rho (similarity method; Pacejka, Tire and Vehicle Dynamics, 4.3). On a road
of friction mu the curve is similar: extremum mu F_e at slip mu S_e, the same stiffness.
"""

from __future__ import annotations

import warp as wp

from twin.vehicle.model import WheelModel

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_THREE = wp.constant(wp.float64(3.0))
_FRICTION_MIN = wp.constant(wp.float64(0.01))


@wp.func
def curve_over_slip(
    rho: wp.float64, shape: wp.float64, tail_slip: wp.float64, tail_force: wp.float64
) -> wp.float64:
    """f(rho) / rho of a friction curve; ``shape`` at rho = 0."""
    if rho <= _ONE:
        return ((shape - _TWO) * rho + _THREE - _TWO * shape) * rho + shape
    t = wp.min((rho - _ONE) / (tail_slip - _ONE), _ONE)
    return (_ONE + (tail_force - _ONE) * t * t * (_THREE - _TWO * t)) / rho


@wp.func
def stiffnesses(
    w: WheelModel, slip: wp.float64, sideslip: wp.float64, load: wp.float64, friction: wp.float64
) -> wp.vec3d:
    """Secant stiffnesses F_x / slip and F_y / sideslip of a wheel [N], and slip over extremum.

    Secants instead of forces: a wheel's spin is solved implicitly with them.
    """
    mu = wp.max(friction, _FRICTION_MIN)
    sx = slip / (w.slip_x * mu)
    sy = sideslip / (w.slip_y * mu)
    rho = wp.sqrt(sx * sx + sy * sy)
    gx = curve_over_slip(rho, w.shape_x, w.tail_slip_x, w.tail_force_x)
    gy = curve_over_slip(rho, w.shape_y, w.tail_slip_y, w.tail_force_y)
    return wp.vec3d(load * w.force_x * gx / w.slip_x, load * w.force_y * gy / w.slip_y, sx)
