"""World coordinates -> WGS-84 latitude, longitude and altitude.

The world is the tangent plane of the ellipsoid at the scene's origin, so a flat street rises above
the ellipsoid by d^2 / (2 R): 2 cm at 500 m. Constants: NIMA TR8350.2. Earth-fixed coordinates to
geodetic ones: Bowring, "Transformation from spatial to geographical coordinates", Survey Review
23 (1976), iterated once more than he needs; near the ground its error is below a micrometre.
"""

from __future__ import annotations

import math

import warp as wp

from twin.base.portable_math import portable_atan2, portable_cos, portable_sin
from twin.world.scene import Origin

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1.0 / 298.257223563
SEMI_MINOR_M = SEMI_MAJOR_M * (1.0 - FLATTENING)
ECCENTRICITY_2 = FLATTENING * (2.0 - FLATTENING)
"""First eccentricity, squared [-]."""

_A = wp.constant(wp.float64(SEMI_MAJOR_M))
_B = wp.constant(wp.float64(SEMI_MINOR_M))
_E2 = wp.constant(wp.float64(ECCENTRICITY_2))
_E2_SECOND = wp.constant(wp.float64(ECCENTRICITY_2 / (1.0 - ECCENTRICITY_2)))
_ONE = wp.constant(wp.float64(1.0))
_DEG = wp.constant(wp.float64(180.0 / math.pi))


@wp.struct
class Datum:
    """Where the world lies on the Earth."""

    origin: wp.vec3d
    """World origin, earth-centred, earth-fixed [m]."""
    axes: wp.mat33d
    """Columns: the world's x, y and z axis, earth-fixed."""


def datum_of(origin: Origin) -> Datum:
    """Datum of a scene's origin."""
    lat, lon = math.radians(origin.latitude_deg), math.radians(origin.longitude_deg)
    sin_lat, cos_lat, sin_lon, cos_lon = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    normal_m = SEMI_MAJOR_M / math.sqrt(1.0 - ECCENTRICITY_2 * sin_lat**2)
    flat_m = (normal_m + origin.altitude_m) * cos_lat
    height_m = (normal_m * (1.0 - ECCENTRICITY_2) + origin.altitude_m) * sin_lat
    east = (-sin_lon, cos_lon, 0.0)
    north = (-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat)
    up = (cos_lat * cos_lon, cos_lat * sin_lon, sin_lat)
    heading = math.radians(origin.heading_deg)
    sin, cos = math.sin(heading), math.cos(heading)
    forward = tuple(sin * e + cos * n for e, n in zip(east, north, strict=True))
    left = tuple(sin * n - cos * e for e, n in zip(east, north, strict=True))
    datum = Datum()
    datum.origin = wp.vec3d(flat_m * cos_lon, flat_m * sin_lon, height_m)
    datum.axes = wp.mat33d(*(axis[k] for k in range(3) for axis in (forward, left, up)))
    return datum


@wp.func
def geodetic(datum: Datum, world: wp.vec3d) -> wp.vec3d:
    """World position [m] -> latitude [deg], longitude [deg], altitude above the ellipsoid [m]."""
    fixed = datum.origin + datum.axes * world
    p = wp.sqrt(fixed[0] * fixed[0] + fixed[1] * fixed[1])
    z = fixed[2]
    reduced = portable_atan2(z * _A, p * _B)
    latitude = reduced
    for _ in range(3):
        s = portable_sin(reduced)
        c = portable_cos(reduced)
        latitude = portable_atan2(z + _E2_SECOND * _B * s * s * s, p - _E2 * _A * c * c * c)
        reduced = portable_atan2(_B * portable_sin(latitude), _A * portable_cos(latitude))
    s = portable_sin(latitude)
    altitude = p * portable_cos(latitude) + z * s - _A * wp.sqrt(_ONE - _E2 * s * s)
    return wp.vec3d(latitude * _DEG, portable_atan2(fixed[1], fixed[0]) * _DEG, altitude)
