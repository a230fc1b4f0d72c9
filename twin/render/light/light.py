"""What lights a slot's picture: one struct per slot, filled on the host."""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from schemas.messages import Lights
from schemas.steady import steady
from twin.world.sky.sun import Daylight
from twin.world.sky.weather import WeatherParameters

CLOUD_HEIGHT_M = 1500.0
"""Height of the clouds' plane over the street [m]."""
_ALOFT = 2.5
"""Wind at the clouds over wind at the ground [-]."""
_DRIZZLE_MPS, _DOWNPOUR_MPS, _FLAKE_MPS = 4.0, 9.0, 1.2


@wp.struct
class SlotLight:
    """Light, air and camera of one slot; luminances in cd/m^2, illuminances in lx, linear RGB."""

    sun_direction: wp.vec3
    sun_rgb: wp.vec3
    sky_rgb: wp.vec3
    cloud_rgb: wp.vec3
    air_rgb: wp.vec3
    moon_direction: wp.vec3
    moon_rgb: wp.vec3
    cloud_drift: wp.vec2
    """Speed of the clouds, over their height [1/s]."""
    cloud_offset: wp.vec2
    """Place that they have reached, over their height."""
    extinction: wp.float32
    exposure: wp.float32
    cloud_cover: wp.float32
    wetness: wp.float32
    snow_cover: wp.float32
    rain: wp.float32
    snow: wp.float32
    fall_mps: wp.float32
    """Speed at which drops or flakes fall [m/s]."""
    fallen_m: wp.float32
    """Distance that drops and flakes have fallen since the case began [m]."""
    slant: wp.vec2
    """Drift of drops and flakes while they fall, over the fall, world x and y [-]."""
    shutter_s: wp.float32
    time_s: wp.float32
    """Sim time of the frame [s]."""
    lamps_on: wp.float32
    low_beam: wp.float32
    high_beam: wp.float32
    fog_lamp: wp.float32
    hazard: wp.float32
    shadows: wp.int32
    noise: wp.int32
    tick: wp.int32
    active: wp.int32
    key: wp.uint64


def fill_light(
    row: np.void,
    light: Daylight,
    weather: WeatherParameters,
    wind_towards: tuple[float, float] = (1.0, 0.0),
) -> None:
    """Write a case's light and weather into ``row``, one element of the host array of SlotLight.

    The sky's table goes into the camera's ``sky_table`` by :func:`fill_sky`. ``wind_towards``: unit
    vector along the wind, world x and y.
    """
    x, y = wind_towards
    # Drops of a downpour are larger and fall faster (Gunn and Kinzer 1949: 4 m/s at 1 mm, 9 at 5).
    drop = _DRIZZLE_MPS + (_DOWNPOUR_MPS - _DRIZZLE_MPS) * weather.rain
    fall_mps = drop if weather.rain >= weather.snow else _FLAKE_MPS
    drift = float(steady(math.tanh(0.4 * weather.wind_mps / fall_mps)))
    aloft = _ALOFT * weather.wind_mps / CLOUD_HEIGHT_M
    values = {
        "sun_direction": light.sun_direction,
        "sun_rgb": light.sun_rgb_lx,
        "sky_rgb": light.sky_rgb_lx,
        "cloud_rgb": light.cloud_rgb,
        "air_rgb": light.air_rgb,
        "moon_direction": light.moon_direction,
        "moon_rgb": light.moon_rgb,
        "cloud_drift": (aloft * x, aloft * y),
        "extinction": weather.extinction_per_m,
        "exposure": light.exposure,
        "cloud_cover": weather.cloud_cover,
        "wetness": weather.wetness,
        "snow_cover": weather.snow_cover,
        "rain": weather.rain,
        "snow": weather.snow,
        "fall_mps": fall_mps,
        "slant": (drift * x, drift * y),
        "shutter_s": light.shutter_s,
        "lamps_on": float(light.lamps_on),
        "shadows": int(light.shadows),
    }
    for name, value in values.items():
        row[name] = value


def fill_sky(table: np.ndarray, light: Daylight) -> None:
    """Write the sky into ``table``, one slot [rows, columns, 3] of a camera's ``sky_table``."""
    table[...] = light.sky


def begin_sky(row: np.void, key: int) -> None:
    """Put clouds where a case begins with them; ``key``: of its stream ``clouds``."""
    row["cloud_offset"] = [(key >> shift & 0xFFF) / 64.0 for shift in (20, 40)]
    row["fallen_m"] = row["time_s"] = 0.0


def advance_light(rows: np.ndarray | np.void, sim_time_s: np.ndarray | float) -> None:
    """Move clouds, drops and flakes on to ``sim_time_s``, at the speeds that hold now.

    To be called at every control period, whether there is a frame or not: then all cameras see the
    same clouds, and a change of the weather moves nothing by a jump.

    Args:
        rows: host SlotLight [S], or one row.
        sim_time_s: float [S], or one number.
    """
    time_s = np.asarray(sim_time_s, np.float64)
    passed = time_s - rows["time_s"]
    rows["cloud_offset"] += rows["cloud_drift"] * passed[..., None]
    rows["fallen_m"] += rows["fall_mps"] * passed
    rows["time_s"] = time_s


def switch_lamps(row: np.void, lights: Lights) -> None:
    """Write the ego's lamps that are on into ``row``; high beam replaces low beam."""
    row["low_beam"] = float(lights.low and not lights.high)
    row["high_beam"] = float(lights.high)
    row["fog_lamp"] = float(lights.fog)
