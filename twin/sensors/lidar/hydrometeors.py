"""Raindrops and snowflakes: how many there are of which size, and what one sends back.

What one particle of diameter D sends back is given as the reflectance of a matt surface of the area
pi D^2 / 4 that sends back as much, a quarter of the backscatter efficiency Q_b.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schemas.sections.lidar import LidarProfile
from twin.sensors.lidar.air import rain_extinction, snow_extinction
from twin.sensors.lidar.surface import is_long_wave

DIAMETERS_MM = np.linspace(0.02, 8.0, 400)
"""At which the tables below stand; of a flake the diameter of its drop of water."""

# Water at 903 to 905 nm and at 1550 nm (Hale and Querry 1973; Kou, Labrie and Chylek 1993).
_INDEX, _ABSORPTION_PER_M = 1.3275, {False: 7.0, True: 810.0}
_FRONT = ((_INDEX - 1.0) / (_INDEX + 1.0)) ** 2
_REAR = (1.0 - _FRONT) ** 2 * _FRONT * (_INDEX / (2.0 - _INDEX)) ** 2

# Backscatter efficiency of a falling drop seen from the side over that of a sphere, by its axis
# ratio: geometric optics, rays traced through oblate spheroids, within a few degrees of the beam
# (tests/kernel/test_drop_rays.py).
_AXIS_RATIO = np.array([0.72, 0.80, 0.85, 0.90, 0.94, 0.97, 1.0])
_OVER_SPHERE = np.array([12.0, 2.4, 1.6, 1.26, 1.12, 1.06, 1.0])

_FLAKE_REFLECTANCE = 2.0 * np.pi / 25.0
"""Lidar ratio of about 25 sr of ice, extinction efficiency of 2."""
_FLAKE_GROWTH = 2.15
"""Diameter of a flake of density 0.1 g/cm^3 over that of its drop of water [-]."""


@dataclass(frozen=True, slots=True)
class Fall:
    """Rain or snow of one rate."""

    n0: float
    slope_per_mm: float
    """Sizes: N(D) = n0 e^(-slope D) [1/(m^3 mm)]."""
    extinction_per_m: float

    def above(self, diameter_mm: np.ndarray) -> np.ndarray:
        """Particles that are larger [1/m^3]."""
        end = np.exp(-self.slope_per_mm * DIAMETERS_MM[-1])
        more = np.exp(-self.slope_per_mm * diameter_mm) - end
        return np.asarray(self.n0 / self.slope_per_mm * np.maximum(more, 0.0))


def fall(rate_mm_per_h: float, *, snow: bool) -> Fall:
    """Rain after Marshall and Palmer (1948); snow, melted, after Sekhon and Srivastava (1970)."""
    if snow:
        slope = 2.29 * rate_mm_per_h**-0.45
        return Fall(2.5e3 * rate_mm_per_h**-0.94, slope, snow_extinction(rate_mm_per_h))
    return Fall(8.0e3, 4.1 * rate_mm_per_h**-0.21, rain_extinction(rate_mm_per_h))


def sphere_efficiency(diameter_mm: np.ndarray, *, long_wave: bool) -> np.ndarray:
    """Backscatter efficiency Q_b of a sphere of water in geometric optics [-].

    The front reflects r = ((n - 1) / (n + 1))^2, and the rear, seen through the front, which
    focuses, (1 - r)^2 r (n / (2 - n))^2 of what absorption leaves. Glory adds to it in spheres
    alone; falling drops are none, and a receiver beside the beam does not look straight back.
    """
    return np.asarray(_FRONT + _REAR * _left(diameter_mm, long_wave))


def drop_reflectance(diameter_mm: np.ndarray, *, long_wave: bool) -> np.ndarray:
    """Reflectance of raindrops seen from the side [-]; axis ratio 1.03 - 0.062 D after Pruppacher
    and Beard (1970). What flattening adds has been through the drop."""
    axis = np.clip(1.03 - 0.062 * np.asarray(diameter_mm), _AXIS_RATIO[0], 1.0)
    shape = np.exp(np.interp(axis, _AXIS_RATIO, np.log(_OVER_SPHERE)))
    inner = shape * (_FRONT + _REAR) - _FRONT
    return np.asarray(0.25 * (_FRONT + inner * _left(diameter_mm, long_wave)))


def _left(diameter_mm: np.ndarray, long_wave: bool) -> np.ndarray:
    """What absorption leaves of light that crosses a drop and comes back [-]."""
    return np.exp(-2e-3 * _ABSORPTION_PER_M[long_wave] * np.asarray(diameter_mm))


def target_mm2(profile: LidarProfile, *, snow: bool) -> np.ndarray:
    """Reflectance times squared diameter of particles of :data:`DIAMETERS_MM` [mm^2]; rising."""
    if snow:
        return np.asarray(_FLAKE_REFLECTANCE * (_FLAKE_GROWTH * DIAMETERS_MM) ** 2)
    long_wave = is_long_wave(profile)
    own = drop_reflectance(DIAMETERS_MM, long_wave=long_wave) * DIAMETERS_MM**2
    return np.maximum.accumulate(own)
