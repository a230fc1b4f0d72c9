"""Daylight: where the sun stands, what it and the sky give, and how the camera exposes for it.

The day is an equinox at 35 deg latitude: sunrise at 06:00, highest sun at noon, sunset at 18:00.
The street's +x points 35 deg east of north, so the morning sun stands to the right ahead and the
noon sun behind.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twin.world.weather import SHADOW_CLOUD_COVER_MAX, WeatherParameters

LATITUDE_DEG = 35.0
"""Latitude of the street [deg]."""
HEADING_DEG = 35.0
"""Compass heading of the street's +x, clockwise from north [deg]."""
CITY_GLOW_LX = 0.4
"""Illuminance of a clouded city sky at night, without street lamps [lx]."""
STREET_LAMPS_BELOW_LX = 60.0
"""Street lamps and window lights are on below this illuminance [lx]."""
EXPOSURE_FLOOR_LX = 130.0
"""The camera exposes no longer than for this illuminance [lx]: night stays dark."""


@dataclass(frozen=True, slots=True)
class Daylight:
    """Light outdoors. Vectors are world-frame or linear RGB of shape (3,)."""

    sun_direction: np.ndarray
    """Unit vector towards the sun."""
    sun_rgb_lx: np.ndarray
    """Illuminance by the sun on a surface that faces it; 0 where it is down or clouded [lx]."""
    sky_rgb_lx: np.ndarray
    """Diffuse illuminance on open level ground [lx]."""
    zenith_rgb: np.ndarray
    """Luminance of the sky at the zenith [cd/m^2]."""
    horizon_rgb: np.ndarray
    """Luminance of the sky at the horizon [cd/m^2]."""
    glow_rgb: np.ndarray
    """Luminance added to the sky around the sun [cd/m^2]."""
    air_rgb: np.ndarray
    """Luminance of an infinitely long path of air, L_air of the fog equation [cd/m^2]."""
    illuminance_lx: float
    """Illuminance on open level ground, without lamps [lx]."""
    exposure: float
    """Factor from luminance to the camera's linear signal [m^2/cd]."""
    shadows: bool
    """The sun casts shadows."""
    lamps_on: bool
    """Street lamps and windows are lit."""


def sun_elevation_rad(time_of_day_min: float) -> float:
    """Elevation of the sun at equinox [rad]: sin h = cos(latitude) cos(hour angle)."""
    hour_angle = math.radians(15.0) * (time_of_day_min / 60.0 - 12.0)
    return math.asin(math.cos(math.radians(LATITUDE_DEG)) * math.cos(hour_angle))


def sun_direction(time_of_day_min: float) -> np.ndarray:
    """Unit vector towards the sun in the world frame, shape (3,)."""
    hour_angle = math.radians(15.0) * (time_of_day_min / 60.0 - 12.0)
    latitude = math.radians(LATITUDE_DEG)
    east = -math.sin(hour_angle)
    north = -math.sin(latitude) * math.cos(hour_angle)
    up = math.cos(latitude) * math.cos(hour_angle)
    heading = math.radians(HEADING_DEG)
    forward = east * math.sin(heading) + north * math.cos(heading)
    left = -east * math.cos(heading) + north * math.sin(heading)
    return np.array([forward, left, up])


def daylight(time_of_day_min: float, weather: WeatherParameters) -> Daylight:
    """Light at a time of day under a weather.

    Clear and overcast skies after the daylight availability model of the Illuminating Engineering
    Society: direct normal 127.5 exp(-0.21 m) klx with air mass m (Kasten 1965), diffuse
    0.8 + 15.5 sqrt(sin h) klx when clear and 0.3 + 21 sin h klx when overcast; between them
    linear in the cloud cover. Twilight falls by a factor of 10 for each 2.2 deg (400 lx at sunset,
    about 3 lx at -6 deg).
    """
    elevation = sun_elevation_rad(time_of_day_min)
    cover = weather.cloud_cover
    up = max(0.0, math.sin(elevation))
    direct_lx = _direct_normal_lx(elevation) * (1.0 - cover) ** 1.5
    shadows = direct_lx > 0.0 and cover < SHADOW_CLOUD_COVER_MAX
    if not shadows:  # what is left of the beam arrives as skylight
        direct_lx = 0.0
    diffuse_lx = _diffuse_lx(elevation, cover) * weather.sky_factor + CITY_GLOW_LX
    illuminance_lx = direct_lx * up + diffuse_lx

    night = min(1.0, max(0.0, -elevation / math.radians(10.0)))
    warmth = max(0.0, 1.0 - abs(elevation) / math.radians(18.0)) * (1.0 - 0.85 * cover)
    clear_zenith = _mix((0.24, 0.56, 1.62), (0.40, 0.55, 1.30), night)
    clear_horizon = _mix((0.80, 1.0, 1.30), (1.5, 0.92, 0.62), warmth)
    gray = np.array([0.96, 1.0, 1.06])
    gray = gray * (1.0 - 0.5 * night) + 0.5 * night * np.array([1.15, 0.95, 0.80])
    zenith = _mix(clear_zenith, gray, cover)
    horizon = _mix(clear_horizon, gray, cover)
    # The means of the two, weighted by what level ground sees, must give the illuminance back.
    base = diffuse_lx / math.pi
    # Overcast skies are three times brighter at the zenith (CIE), clear ones at the horizon.
    zenith = base * zenith * (0.85 + 0.25 * cover)
    horizon = base * horizon * (1.75 - 0.95 * cover)
    sun_color = _mix((1.0, 0.96, 0.88), (1.0, 0.58, 0.28), warmth)
    lamps_on = illuminance_lx < STREET_LAMPS_BELOW_LX
    glow_lx = direct_lx * 0.05 + (6.0 * warmth * math.sqrt(diffuse_lx) if elevation < 0 else 0.0)
    air = _mix(horizon, base * gray, 0.7)
    if lamps_on:
        air = air + np.array([0.28, 0.22, 0.15])  # street lamps scattered by the air
    return Daylight(
        sun_direction=sun_direction(time_of_day_min),
        sun_rgb_lx=direct_lx * sun_color,
        sky_rgb_lx=diffuse_lx * _mix((0.88, 0.98, 1.18), (0.98, 1.0, 1.03), cover),
        zenith_rgb=zenith,
        horizon_rgb=horizon,
        glow_rgb=glow_lx * sun_color * (1.0 - cover),
        air_rgb=air,
        illuminance_lx=illuminance_lx,
        exposure=_exposure(0.45 * direct_lx * up + diffuse_lx),
        shadows=shadows,
        lamps_on=lamps_on,
    )


def _direct_normal_lx(elevation_rad: float) -> float:
    if elevation_rad <= 0.0:
        return 0.0
    degrees = math.degrees(elevation_rad)
    air_mass = 1.0 / (math.sin(elevation_rad) + 0.15 * (degrees + 3.885) ** -1.253)
    return 127_500.0 * math.exp(-0.21 * air_mass)


def _diffuse_lx(elevation_rad: float, cloud_cover: float) -> float:
    if elevation_rad < 0.0:
        return 400.0 * 10.0 ** (math.degrees(elevation_rad) / 2.2) * (1.0 - 0.6 * cloud_cover)
    up = math.sin(elevation_rad)
    clear = 800.0 + 15_500.0 * math.sqrt(up)
    overcast = 300.0 + 21_000.0 * up
    if elevation_rad < math.radians(2.0):  # join the twilight branch without a step
        share = elevation_rad / math.radians(2.0)
        clear = 400.0 + (clear - 400.0) * share
        overcast = 160.0 + (overcast - 160.0) * share
    return clear + (overcast - clear) * cloud_cover


def _exposure(illuminance_lx: float) -> float:
    """White level ground becomes 0.85 of full scale while there is light enough.

    The meter sees about half of the scene in the sun: the caller halves the beam.
    """
    return math.pi * 0.85 / max(illuminance_lx, EXPOSURE_FLOOR_LX)


def _mix(a: object, b: object, share: float) -> np.ndarray:
    return np.asarray(a, float) * (1.0 - share) + np.asarray(b, float) * share
