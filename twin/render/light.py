"""What lights a slot's picture: one struct per slot, filled on the host."""

from __future__ import annotations

import numpy as np
import warp as wp

from schemas.messages import Lights
from twin.world.sun import Daylight
from twin.world.weather import WeatherParameters


@wp.struct
class SlotLight:
    """Light, air and camera of one slot; luminances in cd/m^2, illuminances in lx, linear RGB."""

    sun_direction: wp.vec3
    sun_rgb: wp.vec3
    sky_rgb: wp.vec3
    zenith_rgb: wp.vec3
    horizon_rgb: wp.vec3
    glow_rgb: wp.vec3
    air_rgb: wp.vec3
    extinction: wp.float32
    exposure: wp.float32
    cloud_cover: wp.float32
    wetness: wp.float32
    snow_cover: wp.float32
    rain: wp.float32
    snow: wp.float32
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


def fill_light(row: np.void, light: Daylight, weather: WeatherParameters) -> None:
    """Write a case's constant light into ``row``, one element of the host array of SlotLight."""
    values = {
        "sun_direction": light.sun_direction,
        "sun_rgb": light.sun_rgb_lx,
        "sky_rgb": light.sky_rgb_lx,
        "zenith_rgb": light.zenith_rgb,
        "horizon_rgb": light.horizon_rgb,
        "glow_rgb": light.glow_rgb,
        "air_rgb": light.air_rgb,
        "extinction": weather.extinction_per_m,
        "exposure": light.exposure,
        "cloud_cover": weather.cloud_cover,
        "wetness": weather.wetness,
        "snow_cover": weather.snow_cover,
        "rain": weather.rain,
        "snow": weather.snow,
        "lamps_on": float(light.lamps_on),
        "shadows": int(light.shadows),
    }
    for name, value in values.items():
        row[name] = value


def switch_lamps(row: np.void, lights: Lights) -> None:
    """Write the ego's lamps that are on into ``row``; high beam replaces low beam."""
    row["low_beam"] = float(lights.low and not lights.high)
    row["high_beam"] = float(lights.high)
    row["fog_lamp"] = float(lights.fog)
