"""Radar cross sections of shapes with closed forms, in kernels.

Sphere pi r^2; flat plate 4 pi A^2 / lambda^2 times its lobe; upright cylinder 2 pi r L^2 / lambda
times its lobe; trihedral corner of square plates of edge a, 12 pi a^4 / lambda^2 in its axis, away
from it after Robertson (1947): 4 pi A^2 / lambda^2 with the area A that reflects three times
(Knott, Shaeffer, Tuley: Radar Cross Section, chapters 5 and 6). Nearer than the far field of a side
L, where R < 2 L^2 / lambda, only its first Fresnel zone adds up: L^2 becomes lambda R / 2, which
makes a large plate pi R^2, its mirror image, and a long cylinder pi r R.
"""

from __future__ import annotations

import math

import warp as wp

from twin.base.portable_math import portable_exp, portable_sin
from twin.sensors.radar.bodies import CYLINDER, LOBE, PLATE, SPHERE, TRIHEDRAL

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_LOBE, _SPHERE, _PLATE = (wp.constant(n) for n in (LOBE, SPHERE, PLATE))
_CYLINDER, _TRIHEDRAL = (wp.constant(n) for n in (CYLINDER, TRIHEDRAL))
_ZERO = wp.constant(wp.float64(0.0))
_HALF = wp.constant(wp.float64(0.5))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_FOUR = wp.constant(wp.float64(4.0))
_PI = wp.constant(wp.float64(math.pi))
_SMALL = wp.constant(wp.float64(1.0e-6))
_ROOT_3 = wp.constant(wp.float64(1.0 / math.sqrt(3.0)))
_ROOT_2 = wp.constant(wp.float64(1.0 / math.sqrt(2.0)))
_ROOT_6 = wp.constant(wp.float64(1.0 / math.sqrt(6.0)))


@wp.func
def _side(
    length: wp.float64, sine: wp.float64, distance: wp.float64, wavelength: wp.float64
) -> wp.float64:
    """Square of a side's effective length times its lobe at ``sine`` off its normal [m^2]."""
    zone = wp.min(length * length, _HALF * wavelength * distance)
    effective = wp.sqrt(zone)
    # Near a long side the foot of the perpendicular is on it over a range of angles.
    off = wp.max(wp.abs(sine) - _HALF * (length - effective) / distance, _ZERO)
    x = _TWO * _PI * effective * off / wavelength
    if x < _SMALL:
        return zone
    lobe = portable_sin(x) / x
    return zone * lobe * lobe


@wp.func
def _corner_area(p: wp.float64, q: wp.float64, r: wp.float64) -> wp.float64:
    """Area that reflects three times over the squared edge, by the direction's cosines to the
    edges."""
    low = wp.min(p, wp.min(q, r))
    high = wp.max(p, wp.max(q, r))
    if low <= _ZERO:
        return _ZERO
    middle = p + q + r - low - high
    if middle <= _HALF * high:
        return _FOUR * low * middle / high
    return low * (_FOUR - high / middle)


@wp.func
def cross_section(
    shape: wp.int32,
    size: wp.vec3d,
    normal: wp.vec2d,
    towards: wp.vec3d,
    distance: wp.float64,
    wavelength: wp.float64,
) -> wp.float64:
    """Cross section [m^2] seen from the unit direction ``towards``, in the axes of ``normal``."""
    ahead = towards[0] * normal[0] + towards[1] * normal[1]
    left = towards[1] * normal[0] - towards[0] * normal[1]
    if shape == _SPHERE:
        return _PI * size[0] * size[0]
    if shape == _CYLINDER:
        return _TWO * _PI * size[0] / wavelength * _side(size[1], towards[2], distance, wavelength)
    if ahead <= _ZERO and size[1] < _FOUR:
        return _ZERO
    if shape == _LOBE:
        # 2 (1 - cos) is the square of a small angle.
        spread = _TWO * (_ONE - ahead) / (size[1] * size[1])
        return size[0] * portable_exp(-spread)
    if shape == _PLATE:
        across = _side(size[0], left, distance, wavelength)
        upright = _side(size[1], towards[2], distance, wavelength)
        return _FOUR * _PI * across * upright * ahead * ahead / (wavelength * wavelength)
    base = _ROOT_3 * ahead
    p = base + _TWO * _ROOT_6 * towards[2]
    q = base + _ROOT_2 * left - _ROOT_6 * towards[2]
    r = base - _ROOT_2 * left - _ROOT_6 * towards[2]
    area = size[0] * size[0] * _corner_area(p, q, r)
    return _FOUR * _PI * area * area / (wavelength * wavelength)
