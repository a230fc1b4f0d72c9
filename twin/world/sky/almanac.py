"""Positions of sun and moon, from place, date and time.

Sun: Meeus, *Astronomical Algorithms* (1998), chapter 25 (low accuracy, 0.01 deg), as in NOAA's
solar calculator, with its refraction. Moon: the low-precision series of the *Astronomical Almanac*
(section D: 0.3 deg in longitude, 0.2 deg in latitude), lowered by its parallax.
"""

from __future__ import annotations

import datetime
import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

FULL_MOON_LX = 0.263
"""Illuminance of the full moon (magnitude -12.73, Allen) above the atmosphere [lx]."""


class EarthPlace(Protocol):
    """Place of a scene on the Earth, such as :class:`twin.world.scene.Origin`; x points to
    ``heading_deg``."""

    latitude_deg: float
    longitude_deg: float
    heading_deg: float


@dataclass(frozen=True, slots=True)
class Heavens:
    """Unit vectors towards sun and moon in the world frame (3,), refraction included."""

    sun: np.ndarray
    moon: np.ndarray
    moon_lx: float
    """Illuminance by the moon on a surface that faces it, above the atmosphere [lx]."""
    moon_phase: float
    """Share of the moon's disc that is lit [-]."""

    @property
    def sun_elevation_rad(self) -> float:
        """Elevation of the sun [rad]."""
        return math.asin(max(-1.0, min(1.0, float(self.sun[2]))))

    @property
    def moon_elevation_rad(self) -> float:
        """Elevation of the moon [rad]."""
        return math.asin(max(-1.0, min(1.0, float(self.moon[2]))))


def utc_offset_h(place: EarthPlace) -> float:
    """Local time minus UTC: the place's own, or the time zone of its longitude [h]."""
    own = getattr(place, "utc_offset_h", None)
    return float(round(place.longitude_deg / 15.0)) if own is None else float(own)


def heavens(place: EarthPlace, date: str, minute: float, mode: str = "almanac") -> Heavens:
    """Sun and moon over a place.

    Args:
        date: day ``YYYY-MM-DD`` of the local time.
        minute: local time [minutes after midnight].
        mode: ``almanac``, or ``autodrive``: the sun's pitch is 0.25 deg/min - 90 deg, from east
            over the zenith to west, and a full moon stands opposite.
    """
    if mode == "autodrive":
        pitch = math.radians(0.25 * minute - 90.0)
        sun = _world(place, math.cos(pitch), 0.0, math.sin(pitch))
        return Heavens(sun, -sun, FULL_MOON_LX, 1.0)
    day = julian_day(date, minute - 60.0 * utc_offset_h(place))
    elevation, azimuth = sun_position(day, place.latitude_deg, place.longitude_deg)
    moon_elevation, moon_azimuth, phase_angle = moon_position(
        day, place.latitude_deg, place.longitude_deg
    )
    return Heavens(
        direction_to(place, elevation, azimuth),
        direction_to(place, moon_elevation, moon_azimuth),
        moon_illuminance_lx(phase_angle),
        0.5 * (1.0 + math.cos(math.radians(phase_angle))),
    )


def julian_day(date: str, utc_minute: float) -> float:
    """Julian day of a date and minutes after its midnight, UTC."""
    return datetime.date.fromisoformat(date).toordinal() + 1721424.5 + utc_minute / 1440.0


def sun_position(day: float, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    """Apparent elevation and azimuth from north over east [deg]."""
    longitude, obliquity = _sun_longitude(day)
    elevation, azimuth = _horizontal(day, longitude, 0.0, obliquity, latitude_deg, longitude_deg)
    return elevation + refraction_deg(elevation), azimuth


def moon_position(
    day: float, latitude_deg: float, longitude_deg: float
) -> tuple[float, float, float]:
    """Apparent elevation, azimuth from north over east, and phase angle (0: full) [deg]."""
    t = (day - 2451545.0) / 36525.0

    def sine(amplitude: float, at: float, rate: float) -> float:
        return amplitude * math.sin(math.radians(at + rate * t))

    longitude = 218.32 + 481267.881 * t
    longitude += sine(6.29, 135.0, 477198.87) + sine(-1.27, 259.3, -413335.36)
    longitude += sine(0.66, 235.7, 890534.22) + sine(0.21, 269.9, 954397.74)
    longitude += sine(-0.19, 357.5, 35999.05) + sine(-0.11, 186.5, 966404.03)
    latitude = sine(5.13, 93.3, 483202.02) + sine(0.28, 228.2, 960400.89)
    latitude += sine(-0.28, 318.3, 6003.15) + sine(-0.17, 217.6, -407332.21)
    parallax = 0.9508 + sine(0.0518, 225.0, 477198.87) + sine(0.0095, 349.3, -413335.36)
    sun, obliquity = _sun_longitude(day)
    elevation, azimuth = _horizontal(
        day, longitude, latitude, obliquity, latitude_deg, longitude_deg
    )
    elevation -= parallax * math.cos(math.radians(elevation))
    between = math.cos(math.radians(latitude)) * math.cos(math.radians(longitude - sun))
    elongation = math.degrees(math.acos(max(-1.0, min(1.0, between))))
    return elevation + refraction_deg(elevation), azimuth, 180.0 - elongation


def moon_illuminance_lx(phase_angle_deg: float) -> float:
    """Illuminance by the magnitude -12.73 + 0.026 |i| + 4e-9 i^4 of phase angle i (Allen) [lx]."""
    i = abs(phase_angle_deg)
    return FULL_MOON_LX * 10.0 ** (-0.4 * (0.026 * i + 4.0e-9 * i**4))


def refraction_deg(elevation_deg: float) -> float:
    """Angle by which the atmosphere lifts a body at a true elevation (NOAA) [deg]."""
    if elevation_deg > 85.0:
        return 0.0
    h = elevation_deg
    tangent = math.tan(math.radians(h))
    if h > 5.0:
        seconds = 58.1 / tangent - 0.07 / tangent**3 + 8.6e-5 / tangent**5
    elif h > -0.575:
        seconds = 1735.0 + h * (-518.2 + h * (103.4 + h * (-12.79 + h * 0.711)))
    else:
        seconds = -20.774 / tangent
    return seconds / 3600.0


def _sun_longitude(day: float) -> tuple[float, float]:
    """Apparent ecliptic longitude of the sun and obliquity of the ecliptic [deg]."""
    t = (day - 2451545.0) / 36525.0
    mean = 280.46646 + t * (36000.76983 + 0.0003032 * t)
    anomaly = math.radians(357.52911 + t * (35999.05029 - 0.0001537 * t))
    centre = (1.914602 - t * (0.004817 + 0.000014 * t)) * math.sin(anomaly)
    centre += (0.019993 - 0.000101 * t) * math.sin(2 * anomaly) + 0.000289 * math.sin(3 * anomaly)
    node = math.radians(125.04 - 1934.136 * t)
    obliquity = 23.0 + (26.0 + (21.448 - t * (46.815 + t * (0.00059 - 0.001813 * t))) / 60.0) / 60.0
    longitude = mean + centre - 0.00569 - 0.00478 * math.sin(node)
    return longitude, obliquity + 0.00256 * math.cos(node)


def _horizontal(
    day: float,
    longitude: float,
    latitude: float,
    obliquity: float,
    place_latitude: float,
    place_longitude: float,
) -> tuple[float, float]:
    """Ecliptic -> geometric elevation and azimuth from north over east, all [deg]."""
    lam, beta, eps = (math.radians(a) for a in (longitude, latitude, obliquity))
    x = math.cos(beta) * math.cos(lam)
    y = math.cos(eps) * math.cos(beta) * math.sin(lam) - math.sin(eps) * math.sin(beta)
    z = math.sin(eps) * math.cos(beta) * math.sin(lam) + math.cos(eps) * math.sin(beta)
    turned = day - 2451545.0
    t = turned / 36525.0
    sidereal = 280.46061837 + 360.98564736629 * turned + 0.000387933 * t * t
    hour = math.radians(sidereal + place_longitude) - math.atan2(y, x)
    phi = math.radians(place_latitude)
    declination = math.asin(max(-1.0, min(1.0, z)))
    east = -math.cos(declination) * math.sin(hour)
    north = math.cos(phi) * math.sin(declination)
    north -= math.sin(phi) * math.cos(declination) * math.cos(hour)
    up = math.sin(phi) * math.sin(declination)
    up += math.cos(phi) * math.cos(declination) * math.cos(hour)
    elevation = math.degrees(math.asin(max(-1.0, min(1.0, up))))
    return elevation, math.degrees(math.atan2(east, north)) % 360.0


def direction_to(place: EarthPlace, elevation_deg: float, azimuth_deg: float) -> np.ndarray:
    """Unit vector of an elevation and an azimuth from north over east, world frame (3,)."""
    h, a = math.radians(elevation_deg), math.radians(azimuth_deg)
    return _world(place, math.cos(h) * math.sin(a), math.cos(h) * math.cos(a), math.sin(h))


def _world(place: EarthPlace, east: float, north: float, up: float) -> np.ndarray:
    heading = math.radians(place.heading_deg)
    forward = east * math.sin(heading) + north * math.cos(heading)
    left = -east * math.cos(heading) + north * math.sin(heading)
    return np.array([forward, left, up])
