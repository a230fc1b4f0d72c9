"""Light of day and night: what sun, moon and sky give, and how the camera exposes for it.

Illuminances are those of the literature (they decide exposure and what perception can see); the
distribution of light over the sky and all colours come from :mod:`twin.world.sky.atmosphere`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from schemas.steady import steady
from twin.world.sky import atmosphere, sky_table
from twin.world.sky.almanac import EarthPlace, Heavens, heavens
from twin.world.sky.atmosphere import LUMINANCE, SUN_RGB
from twin.world.sky.weather import AIR_PER_M, SHADOW_CLOUD_COVER_MAX, WeatherParameters

CITY_GLOW_LX = (0.02, 0.60)
"""Illuminance of a city sky at night without its lamps: clear, and what closed cloud adds [lx]
(amplification by cloud of one to two orders of magnitude: Jechow et al. 2017, 2019)."""
STREET_LAMPS_BELOW_LX = 60.0
"""Street lamps and window lights are on below this illuminance [lx]."""
EXPOSURE_FLOOR_LX = 48.0
"""The camera exposes no longer than for this illuminance [lx]: night stays dark."""
LAMP_AIR_RGB = np.array([0.8, 0.62, 0.41])
"""Luminance of a long path of air in a lit street: 20 lx from all sides over 4 pi, half the way."""
WHITE_SIGNAL = 2.0
"""Signal of open white level ground under automatic exposure: half of it is left between houses,
and the tone curve holds highlights up to 6 [-]."""
MOON_DISC_CDPM2 = 2500.0
"""Luminance of the lit part of the moon above the atmosphere [cd/m^2]."""
_CLOSED_COVER = 0.9  # from here on nothing of the clear sky is left
_LAYER_M = 100.0
"""Depth of fog, rain and snow that the sun's beam crosses upright (inferred) [m]."""
_SUNLIT_SHARE = 0.25  # of a street between houses
_ROW_45 = round((sky_table.ROWS - 1) * math.sqrt(math.sqrt(0.5)))  # row of the sky at 45 deg


@dataclass(frozen=True, slots=True)
class _Here:
    """South Carolina, looking east: the place of the shipped street."""

    latitude_deg: float = 34.8
    longitude_deg: float = -82.32
    heading_deg: float = 90.0


HERE = _Here()
DATE = "2025-03-20"


@dataclass(frozen=True, slots=True)
class Daylight:
    """Light outdoors. Vectors are world-frame or linear RGB of shape (3,)."""

    sun_direction: np.ndarray
    """Unit vector towards the sun."""
    sun_rgb_lx: np.ndarray
    """Illuminance by the sun on a surface that faces it; 0 where it is down or clouded [lx]."""
    sky_rgb_lx: np.ndarray
    """Diffuse illuminance on open level ground [lx]."""
    sky: np.ndarray
    """Luminance of the sky without clouds' shapes, float32 [rows, columns, 3] [cd/m^2]; axes as in
    :mod:`twin.world.sky.sky_table`."""
    cloud_rgb: np.ndarray
    """Luminance of a bright cloud [cd/m^2]."""
    air_rgb: np.ndarray
    """Luminance of an infinitely long path of air, L_air of the fog equation [cd/m^2]."""
    moon_direction: np.ndarray
    """Unit vector towards the moon."""
    moon_rgb: np.ndarray
    """Luminance of the lit part of its disc [cd/m^2]."""
    illuminance_lx: float
    """Illuminance on open level ground, without lamps [lx]."""
    exposure: float
    """Factor from luminance to the camera's linear signal [m^2/cd]."""
    shutter_s: float
    """Exposure time of the camera [s]."""
    shadows: bool
    """The sun casts shadows."""
    lamps_on: bool
    """Street lamps and windows are lit."""

    @property
    def zenith_rgb(self) -> np.ndarray:
        """Luminance of the sky at the zenith [cd/m^2]."""
        return self.sky[-1].mean(axis=0)


def daylight(
    time_of_day_min: float,
    weather: WeatherParameters,
    *,
    place: EarthPlace = HERE,
    date: str = DATE,
    mode: str = "almanac",
    exposure_ev100: float | None = None,
) -> Daylight:
    """Light at a local time of day under a weather; see :func:`twin.world.sky.almanac.heavens`."""
    return daylight_under(heavens(place, date, time_of_day_min, mode), weather, exposure_ev100)


def daylight_under(
    bodies: Heavens, weather: WeatherParameters, exposure_ev100: float | None = None
) -> Daylight:
    """Light of sun and moon at their places.

    Daylight after the availability model of the Illuminating Engineering Society: direct normal
    127.5 exp(-0.21 m) klx with air mass m (Kasten 1965), diffuse 0.8 + 15.5 sqrt(sin h) klx when
    clear and 0.3 + 21 sin h klx when overcast; of a cloud cover c the sum of (1 - c / 0.9)^2 and c
    of them. Twilight after Janiczek and DeYoung, USNO Circular 171 (1987).
    """
    elevation = bodies.sun_elevation_rad
    cover = weather.cloud_cover
    level = atmosphere.haze_level(min(weather.extinction_per_m, 2.0e-4) - 0.12 * AIR_PER_M)
    up = max(0.0, math.sin(elevation))
    # The beam is gone where it casts no shadow, and gets there without a step.
    gaps = max(0.0, 1.0 - cover / SHADOW_CLOUD_COVER_MAX)
    direct_lx = _direct_normal_lx(elevation) * gaps * gaps * (3.0 - 2.0 * gaps)
    thick = max(0.0, weather.extinction_per_m - 2.0 * AIR_PER_M) * _LAYER_M
    direct_lx *= weather.sky_factor * math.exp(-thick / max(up, 0.1))
    shadows = direct_lx > 1.0
    clear_lx, overcast_lx = _diffuse_lx(elevation)
    seen = max(0.0, 1.0 - cover / _CLOSED_COVER) ** 2
    sun_color = _sun_color(elevation, level)
    gray = _cloud_color(elevation)
    sky = sky_table.clear(bodies.sun, elevation, level) * SUN_RGB
    sky = sky_table.scaled(sky, clear_lx * seen * weather.sky_factor)
    sky = sky + sky_table.overcast(gray, overcast_lx * cover * weather.sky_factor)
    sky = sky + _night_sky(bodies, cover, level)
    sky_rgb_lx = sky_table.illuminance_rgb(sky)
    diffuse_lx = float(sky_rgb_lx @ LUMINANCE)
    illuminance_lx = direct_lx * up + diffuse_lx
    lamps_on = illuminance_lx < STREET_LAMPS_BELOW_LX
    ground_rgb = sky_rgb_lx + direct_lx * up * sun_color
    metered_lx = _SUNLIT_SHARE * direct_lx * up + diffuse_lx
    moon_left = atmosphere.sunlight_left(bodies.moon_elevation_rad, level) * (1.0 - cover)
    exposure = _exposure(metered_lx, exposure_ev100)
    shutter_s = (EXPOSURE_FLOOR_LX / max(metered_lx, EXPOSURE_FLOOR_LX)) ** 0.15 / 60.0
    return Daylight(
        sun_direction=steady(bodies.sun),
        sun_rgb_lx=steady(direct_lx * sun_color),
        sky_rgb_lx=steady(sky_rgb_lx),
        sky=steady(sky).astype(np.float32),
        cloud_rgb=steady(_cloud(sky, ground_rgb, cover)),
        air_rgb=steady(_air(sky, ground_rgb, weather, lamps_on)),
        moon_direction=steady(bodies.moon),
        moon_rgb=steady(MOON_DISC_CDPM2 * SUN_RGB * moon_left),
        illuminance_lx=float(steady(illuminance_lx)),
        exposure=float(steady(exposure)),
        shutter_s=float(steady(shutter_s)),
        shadows=shadows,
        lamps_on=lamps_on,
    )


def clear_illuminance_lx(elevation_rad: float) -> float:
    """Illuminance by the sun and a clear sky on open level ground [lx]."""
    direct_lx = _direct_normal_lx(elevation_rad) * max(0.0, math.sin(elevation_rad))
    return direct_lx + _diffuse_lx(elevation_rad)[0]


def _direct_normal_lx(elevation_rad: float) -> float:
    if elevation_rad <= 0.0:
        return 0.0
    degrees = math.degrees(elevation_rad)
    air_mass = 1.0 / (math.sin(elevation_rad) + 0.15 * (degrees + 3.885) ** -1.253)
    return 127_500.0 * math.exp(-0.21 * air_mass)


def _diffuse_lx(elevation_rad: float) -> tuple[float, float]:
    """Diffuse illuminance under a clear and an overcast sky, without city and moon [lx]."""
    if elevation_rad < 0.0:
        twilight = twilight_lx(math.degrees(elevation_rad)) / twilight_lx(0.0)
        return 800.0 * twilight, 300.0 * twilight
    up = math.sin(elevation_rad)
    return 800.0 + 15_500.0 * math.sqrt(up), 300.0 + 21_000.0 * up


# Lowest elevation [deg], and log10 of lux as a polynomial of elevation over 90 deg.
_TWILIGHT = (
    (-0.8, (2.88, 22.26, -207.64, 1034.30)),
    (-5.0, (2.88, 21.81, -258.11, -858.36)),
    (-12.0, (2.70, 12.17, -431.69, -1899.83)),
    (-18.0, (13.84, 262.72, 1447.42, 2797.93)),
)


def twilight_lx(elevation_deg: float) -> float:
    """Illuminance by a sun on or below the horizon under a clear sky [lx] (USNO Circular 171)."""
    x = max(elevation_deg, -18.0) / 90.0
    a, b, c, d = next((p for low, p in _TWILIGHT if 90.0 * x >= low), _TWILIGHT[-1][1])
    return float(10.0 ** (a + x * (b + x * (c + x * d))))


def _sun_color(elevation_rad: float, level: int) -> np.ndarray:
    """Colour of the sun through the air, linear RGB of luminance 1."""
    rgb = SUN_RGB * atmosphere.sunlight_left(max(elevation_rad, math.radians(0.3)), level)
    return rgb / (rgb @ LUMINANCE)


def _cloud_color(elevation_rad: float) -> np.ndarray:
    """Colour of light below thick cloud, luminance 1: white by day, bluer as the sun goes down."""
    dusk = max(0.0, 1.0 - max(0.0, math.degrees(elevation_rad)) / 15.0)
    rgb = _mix((0.97, 1.0, 1.05), (0.84, 1.0, 1.32), dusk)
    return rgb / (rgb @ LUMINANCE)


def _night_sky(bodies: Heavens, cover: float, level: int) -> np.ndarray:
    """Moonlit sky and the glow of the city, luminance [rows, columns, 3]."""
    warm = np.array([1.28, 0.96, 0.62])
    sky = sky_table.city(warm, CITY_GLOW_LX[0] + CITY_GLOW_LX[1] * cover * cover)
    elevation = bodies.moon_elevation_rad
    if elevation > 0.0:
        moon = sky_table.clear(bodies.moon, elevation, level) * SUN_RGB * bodies.moon_lx
        beam = atmosphere.sunlight_left(elevation, level) * SUN_RGB * bodies.moon_lx
        beam_lx = float(beam @ LUMINANCE) * math.sin(elevation)
        # The moon's beam is no source of its own in the picture: it arrives with its sky.
        own_lx = float(sky_table.illuminance_rgb(moon) @ LUMINANCE)
        sky = sky + moon * (1.0 - cover)
        sky = sky + sky_table.overcast(np.ones(3), beam_lx * (1.0 - cover) + own_lx * 0.5 * cover)
    return sky


def _cloud(sky: np.ndarray, ground_rgb: np.ndarray, cover: float) -> np.ndarray:
    """Bright side of a cloud: white in what falls on it; of thick cover a little above the sky."""
    lone = ground_rgb * (0.62 / math.pi)
    closed = sky[_ROW_45].mean(axis=0) * 1.15
    return _mix(lone, closed, min(1.0, max(0.0, (cover - 0.3) / 0.4)))


def _air(
    sky: np.ndarray, ground_rgb: np.ndarray, weather: WeatherParameters, lamps_on: bool
) -> np.ndarray:
    """Clear air is as bright as the horizon; fog as the light that falls into it, and whiter."""
    horizon = sky[0].mean(axis=0)
    lit = ground_rgb * (0.75 / math.pi)
    white = np.full(3, float(lit @ LUMINANCE))
    thick = weather.extinction_per_m / (weather.extinction_per_m + 1.0e-3)
    air = _mix(horizon, _mix(lit, white, 0.6), thick)
    return air + LAMP_AIR_RGB if lamps_on else air


def _exposure(illuminance_lx: float, ev100: float | None) -> float:
    """White level ground has the signal :data:`WHITE_SIGNAL` while there is light enough.

    The meter sees a part of a street in the sun; the caller weighs the beam. A fixed exposure value
    saturates at 1.2 2^EV100 cd/m^2 (ISO 12232, saturation-based speed).
    """
    if ev100 is not None:
        return 1.0 / (1.2 * 2.0**ev100)
    return math.pi * WHITE_SIGNAL / max(illuminance_lx, EXPOSURE_FLOOR_LX)


def _mix(a: object, b: object, share: float) -> np.ndarray:
    return np.asarray(a, float) * (1.0 - share) + np.asarray(b, float) * share
