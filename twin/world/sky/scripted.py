"""Weather, light and road as a scenario changes them while it runs, in physical units."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime, timedelta

import numpy as np

from schemas.steady import steady
from twin.world.sky.almanac import EarthPlace, Heavens, direction_to, heavens
from twin.world.sky.sun import clear_illuminance_lx
from twin.world.sky.weather import (
    AIR_PER_M,
    GUST_SHARE,
    MOR_PER_EXTINCTION,
    WeatherParameters,
    fog_extinction_per_m,
    overridden,
    with_parts,
)

SUN_LX_MIN = 1.0
"""A light in the sky that gives less is the moon [lx]: its brightest is 0.3 lx."""
FOG_RANGE_MIN_M = 1.0
"""Fog is no thicker than this visual range [m]."""
FRICTION_LIMITS = (0.01, 1.5)
"""Friction of a road that a scenario scales stays between these [-]."""
_NIGHT_RAD = math.radians(-18.0)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class ScriptedEnvironment:
    """What a scenario has said so far; None: nothing, it is as the campaign says."""

    clock_s: float | None = None
    """Date and time as a clock at the place shows it, counted from 1970 [s]."""
    minute_of_day: float | None = None
    """Local time without a date [minutes after midnight]."""
    cloud_fraction: float | None = None
    """Share of the sky under cloud [-], 0..1."""
    fog_visual_range_m: float | None = None
    """Meteorological optical range in the fog [m]."""
    rain_mm_per_h: float | None = None
    snow_mm_per_h: float | None = None
    """Snowfall as water [mm/h]."""
    sun_azimuth_rad: float | None = None
    """From north to the west [rad]."""
    sun_elevation_rad: float | None = None
    sun_illuminance_lx: float | None = None
    """What it gives on open level ground [lx]."""
    wind_direction_rad: float | None = None
    """Heading of the wind, where it blows to [rad]."""
    wind_speed_mps: float | None = None
    water_mm: float | None = None
    """Water film that one sees on the road [mm]; its friction is what the factor says."""
    friction_factor: float | None = None
    """Friction of the road over what it has in this weather [-]."""

    def then(self, later: ScriptedEnvironment) -> ScriptedEnvironment:
        """What holds after a later word: a time that it gives replaces time and sun, a sun of its
        own the sun."""
        base = self
        timed = later.clock_s is not None or later.minute_of_day is not None
        if timed or later.sun_elevation_rad is not None:
            base = replace(
                base, sun_azimuth_rad=None, sun_elevation_rad=None, sun_illuminance_lx=None
            )
        if timed:
            base = replace(base, clock_s=None, minute_of_day=None)
        values = {field.name: getattr(later, field.name) for field in fields(later)}
        return replace(base, **{name: v for name, v in values.items() if v is not None})

    def weather(self, base: WeatherParameters, family: str) -> WeatherParameters:
        """The campaign's weather with what the scenario says in place of it; friction of the road
        stays for :meth:`on_road`."""
        if self.cloud_fraction is not None:
            base = replace(base, cloud_cover=self.cloud_fraction)
        parts = (self.fog_visual_range_m, self.rain_mm_per_h, self.snow_mm_per_h)
        if parts != (None, None, None):
            fog_per_m = fog_extinction_per_m(base)
            if self.fog_visual_range_m is not None:
                range_m = max(self.fog_visual_range_m, FOG_RANGE_MIN_M)
                fog_per_m = max(0.0, MOR_PER_EXTINCTION / range_m - AIR_PER_M)
            rain = base.rain_mm_per_h if self.rain_mm_per_h is None else self.rain_mm_per_h
            snow = base.snow_mm_per_h if self.snow_mm_per_h is None else self.snow_mm_per_h
            base = with_parts(base, fog_per_m, rain, snow, family)
        if self.wind_speed_mps is not None:
            gust = float(steady(GUST_SHARE * self.wind_speed_mps, 24))
            base = replace(base, wind_mps=self.wind_speed_mps, gust_mps=gust)
        return base

    def on_road(self, weather: WeatherParameters) -> WeatherParameters:
        """The weather on the road as the scenario has it."""
        if self.water_mm is not None:
            weather = overridden(weather, weather.friction, self.water_mm)
        if self.friction_factor is None:
            return weather
        friction = min(weather.friction * self.friction_factor, FRICTION_LIMITS[1])
        return replace(weather, friction=max(friction, FRICTION_LIMITS[0]))

    @property
    def changes_air(self) -> bool:
        """Whether clouds, fog, rain or snow are the scenario's."""
        parts = (self.cloud_fraction, self.fog_visual_range_m)
        return any(part is not None for part in (*parts, self.rain_mm_per_h, self.snow_mm_per_h))

    @property
    def wind_towards(self) -> tuple[float, float] | None:
        """Unit vector along the wind, world x and y; None: the campaign's."""
        if self.wind_direction_rad is None:
            return None
        turn = self.wind_direction_rad
        return round(math.cos(turn), 9), round(math.sin(turn), 9)  # the same on every host

    @property
    def minute(self) -> float | None:
        """Local time [minutes after midnight]; None: the campaign's."""
        return self.minute_of_day if self.clock_s is None else self.clock_s % 86_400.0 / 60.0

    def heavens(self, place: EarthPlace, date: str, minute: float, mode: str) -> Heavens:
        """Sun and moon: at the scenario's time, the sun where the scenario has it.

        A sun that gives less light than it would at its height stands lower; below
        :data:`SUN_LX_MIN` it is the moon, and the sun is down.
        """
        if self.clock_s is not None:
            date = (_EPOCH + timedelta(seconds=self.clock_s)).date().isoformat()
        bodies = heavens(place, date, minute, mode)
        if self.sun_elevation_rad is None or self.sun_azimuth_rad is None:
            return bodies
        height, clockwise_deg = self.sun_elevation_rad, -math.degrees(self.sun_azimuth_rad)
        light_lx = self.sun_illuminance_lx
        if light_lx is None or light_lx >= SUN_LX_MIN:
            if light_lx is not None and clear_illuminance_lx(height) > light_lx:
                height = _height_of(light_lx, height)
            return replace(bodies, sun=direction_to(place, math.degrees(height), clockwise_deg))
        down = direction_to(place, math.degrees(_NIGHT_RAD), clockwise_deg)
        moon = direction_to(place, math.degrees(height), clockwise_deg)
        up = max(float(np.sin(height)), 0.1)
        return Heavens(down, moon, light_lx / up, 1.0)


def _height_of(light_lx: float, highest_rad: float) -> float:
    """Elevation at which a sun under a clear sky gives so much light [rad]."""
    low, high = _NIGHT_RAD, highest_rad
    for _ in range(40):
        middle = 0.5 * (low + high)
        if clear_illuminance_lx(middle) < light_lx:
            low = middle
        else:
            high = middle
    return float(steady(high))
