"""Weather: one physical parameter set that drives optics, LiDAR and tyre friction together.

A weather is a point in five intensities (:class:`schemas.sections.environment.Conditions`); the
eight presets are such points too, so that anything between and beside them is a weather as well. A
*family* says what an intensity means physically.

``physical``: extinctions of visible light add, b = air + fog + rain + snow.

* Clear air: meteorological optical range MOR = 2.996 / b of 30 km (5 % contrast, Koschmieder).
* Fog: MOR 500 m at intensity 0.5 and 120 m at 1.
* Rain: 2 mm/h at 0.5, 25 mm/h at 1; 1.076 R^0.67 dB/km (ITU-R P.1814), half as much again for the
  mist and spray that come with it (inferred; visibilities of 6 and 1.2 km at the presets).
* Snow: visibility V = 3.912 / b (2 % contrast) of 3 km at 0.5 and 400 m at 1. The rate of water
  follows by the inverse of ITU-R P.1814 for dry snow, 5.53 S^1.38 dB/km: 1.0 and 4.4 mm/h.
* Friction at 50 km/h: dry 0.80; water film of 0.2 mm 0.65, of 1 mm 0.55, of 2 mm 0.50 (Bosch
  Automotive Handbook, new tyres); snow 0.30 and 0.20.

Between those points intensities follow power laws (optics) or straight lines (road).

``autodrive``: mean free paths 1 / b of AutoDRIVE's presets, fog 50 + (1 - I) 200 m as soon as there
is any, rain and snow 100 / I m; the road is dry and nothing blows in the presets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import msgspec
import numpy as np

from schemas.sections.environment import Conditions, Environment
from schemas.steady import steady
from schemas.validation import suggest

MOR_PER_EXTINCTION = 2.996
"""Meteorological optical range times extinction: -ln 0.05 [-]."""
VISIBILITY_PER_EXTINCTION = 3.912
"""Visibility times extinction: -ln 0.02 [-]."""
AIR_PER_M = MOR_PER_EXTINCTION / 30_000.0
"""Extinction of clear air [1/m]."""
SHADOW_CLOUD_COVER_MAX = 0.6
"""Cloud cover from which on the sun casts no shadow [-]."""

_FOG_MOR_M = (500.0, 120.0)
_SNOW_VISIBILITY_M = (3000.0, 400.0)
_RAIN_MM_PER_H = (2.0, 25.0)
_DB_PER_KM = 1e-4 * math.log(10.0)
"""1 dB/km as an extinction [1/m]."""
_MIST_SHARE = 0.5
_STEPS = (0.0, 0.5, 1.0)
"""Intensities at which the tables below stand: none, light, heavy."""
_FILM_MM = (0.0, 0.2, 1.0, 2.0)
_FILM_FRICTION = (0.80, 0.65, 0.55, 0.50)
_SNOW_FRICTION = (0.80, 0.30, 0.20)
GUST_SHARE = 0.2
"""Standard deviation of gusts over mean wind near the ground; see :mod:`twin.world.sky.wind`."""


@dataclass(frozen=True, slots=True)
class WeatherParameters:
    """What a weather means physically."""

    extinction_per_m: float
    """Extinction of visible light, the inverse of the mean free path [1/m], > 0."""
    cloud_cover: float
    """Share of the sky under thick cloud [-], 0..1; from 0.6 on the sun casts no shadow."""
    sky_factor: float
    """Daylight that is left below the clouds' rain or snow [-], 0..1."""
    rain: float
    """Amount of rain one sees [-], 0 none, 1 heavy."""
    snow: float
    """Amount of falling snow one sees [-], 0 none, 1 heavy."""
    wetness: float
    """Water on the road [-], 0 dry, 1 a closed film."""
    snow_cover: float
    """Share of open ground under snow [-], 0..1."""
    friction: float
    """Tyre-road friction coefficient [-]."""
    rain_mm_per_h: float
    """Rain rate [mm/h]."""
    snow_mm_per_h: float
    """Snowfall as water [mm/h]."""
    wind_mps: float
    """Mean wind [m/s]."""
    gust_mps: float
    """Standard deviation of gusts along and across the wind [m/s]."""
    water_mm: float
    """Thickness of the water film on the road [mm]."""

    @property
    def mor_m(self) -> float:
        """Meteorological optical range: contrast falls to 5 % [m]."""
        return MOR_PER_EXTINCTION / self.extinction_per_m


PRESETS: dict[str, Conditions] = {
    "clear": Conditions(cloud=0.12, wind=0.15),
    "cloudy": Conditions(cloud=0.85, wind=0.3),
    "light_fog": Conditions(cloud=0.6, fog=0.5, wind=0.1),
    "heavy_fog": Conditions(cloud=0.8, fog=1.0, wind=0.05),
    "light_rain": Conditions(cloud=0.9, rain=0.5, wind=0.3),
    "heavy_rain": Conditions(cloud=1.0, rain=1.0, wind=0.5),
    "light_snow": Conditions(cloud=0.9, snow=0.5, wind=0.2),
    "heavy_snow": Conditions(cloud=1.0, snow=1.0, wind=0.5),
}
"""Intensities of the weathers of :data:`schemas.names.WEATHERS`."""


def weather_of(name: str, environment: Environment = Environment()) -> WeatherParameters:
    """Parameters of a preset, or of a weather of the ``environment``, with the intensities that
    hold there whatever the weather.

    Raises:
        ValueError: no such weather; one line.
    """
    own = environment.custom
    conditions = PRESETS.get(name) or own.get(name)
    if conditions is None:
        raise ValueError(f"weather '{name}': {suggest(name, [*PRESETS, *own])}")
    intensities = environment.intensities()
    if environment.family == "autodrive" and name in PRESETS and not intensities:
        return WEATHER_AUTODRIVE[name]
    return parameters(msgspec.structs.replace(conditions, **intensities), environment.family)


def parameters(conditions: Conditions, family: str = "physical") -> WeatherParameters:
    """What ``conditions`` mean physically in a family."""
    c = conditions
    rain_mm_per_h = rain_at(c.rain)
    snow_per_m = _snow_per_m(c.snow)
    extinction_per_m = AIR_PER_M + _fog_per_m(c.fog) + _rain_per_m(rain_mm_per_h) + snow_per_m
    water_mm = max(_table(c.rain, _FILM_MM[:3]), 0.02 * c.fog, 0.05 * c.snow)
    wind_mps = _steady(0.836 * (9.0 * c.wind) ** 1.5)  # Beaufort's scale, up to 9
    physical = WeatherParameters(
        extinction_per_m=_steady(extinction_per_m),
        cloud_cover=c.cloud,
        sky_factor=(1.0 - 0.25 * c.fog)
        * (1.0 - _table(c.rain, (0.0, 0.2, 0.5)))
        * (1.0 - _table(c.snow, (0.0, 0.1, 0.3))),
        rain=_steady((rain_mm_per_h / _RAIN_MM_PER_H[1]) ** 0.42),
        snow=_table(c.snow, (0.0, 0.35, 1.0)),
        wetness=max(
            _table(c.rain, (0.0, 0.6, 1.0)),
            _table(c.snow, (0.0, 0.3, 0.3)),
            _table(c.fog, (0.0, 0.15, 0.25)),
        ),
        snow_cover=_table(c.snow, (0.0, 0.55, 0.95)),
        friction=min(film_friction(_table(c.rain, _FILM_MM[:3])), _table(c.snow, _SNOW_FRICTION)),
        rain_mm_per_h=rain_mm_per_h,
        snow_mm_per_h=snowfall_at(c.snow),
        wind_mps=wind_mps,
        gust_mps=GUST_SHARE * wind_mps,
        water_mm=water_mm,
    )
    return physical if family == "physical" else _autodrive(physical, c)


def fog_extinction_per_m(weather: WeatherParameters) -> float:
    """What fog adds to the extinction of a weather [1/m]."""
    rest = weather.extinction_per_m - AIR_PER_M - _rain_per_m(weather.rain_mm_per_h)
    return max(0.0, rest - _snowfall_per_m(weather.snow_mm_per_h))


def rain_at(intensity: float) -> float:
    """Rain of an intensity from 0 to 1 [mm/h]."""
    return _steady(_through(intensity, *_RAIN_MM_PER_H))


def snowfall_at(intensity: float) -> float:
    """Snowfall of an intensity from 0 to 1, as water [mm/h]."""
    return _steady((_snow_per_m(intensity) / _DB_PER_KM / 5.53) ** (1.0 / 1.38))


def with_parts(
    base: WeatherParameters,
    fog_per_m: float,
    rain_mm_per_h: float,
    snow_mm_per_h: float,
    family: str = "physical",
) -> WeatherParameters:
    """The weather with other fog, rain and snow; clouds and wind stay.

    Args:
        fog_per_m: extinction that fog adds [1/m].
        rain_mm_per_h: rain; of more than heavy rain, sight suffers and nothing else.
        snow_mm_per_h: snowfall as water, in the same way.
    """
    snow_per_m = _snowfall_per_m(snow_mm_per_h)
    light, heavy = (VISIBILITY_PER_EXTINCTION / v_m - AIR_PER_M for v_m in _SNOW_VISIBILITY_M)
    thin, thick = (MOR_PER_EXTINCTION / mor_m - AIR_PER_M for mor_m in _FOG_MOR_M)
    conditions = Conditions(
        cloud=base.cloud_cover,
        fog=_intensity(fog_per_m, thin, thick),
        rain=_intensity(rain_mm_per_h, *_RAIN_MM_PER_H),
        snow=_intensity(snow_per_m, light, heavy),
    )
    extinction_per_m = AIR_PER_M + fog_per_m + _rain_per_m(rain_mm_per_h) + snow_per_m
    return replace(
        parameters(conditions, family),
        extinction_per_m=_steady(extinction_per_m),
        rain_mm_per_h=rain_mm_per_h,
        snow_mm_per_h=snow_mm_per_h,
        wind_mps=base.wind_mps,
        gust_mps=base.gust_mps,
    )


def film_friction(water_mm: float) -> float:
    """Friction at 50 km/h on a water film [mm] (Bosch Automotive Handbook, new tyres) [-]."""
    return float(np.interp(water_mm, _FILM_MM, _FILM_FRICTION))


def overridden(
    weather: WeatherParameters, friction: float | None, water_mm: float | None
) -> WeatherParameters:
    """The weather on a road with another water film [mm] or friction; None leaves it alone."""
    if water_mm is not None:
        wet = float(np.interp(water_mm, _FILM_MM[:3], (0.0, 0.6, 1.0)))
        grip = min(film_friction(water_mm), weather.friction)
        if weather.snow_cover == 0.0:
            grip = film_friction(water_mm)
        weather = replace(weather, water_mm=water_mm, wetness=wet, friction=grip)
    return weather if friction is None else replace(weather, friction=friction)


def blended(a: WeatherParameters, b: WeatherParameters, share: float) -> WeatherParameters:
    """The weather ``share`` of the way from ``a`` to ``b``, every parameter on a straight line."""
    names = [field.name for field in fields(WeatherParameters)]
    mixed = {n: getattr(a, n) * (1.0 - share) + getattr(b, n) * share for n in names}
    return WeatherParameters(**mixed)


def _autodrive(physical: WeatherParameters, c: Conditions) -> WeatherParameters:
    fog = 1.0 / (50.0 + (1.0 - c.fog) * 200.0) if c.fog > 0.0 else 0.0
    total = fog + 0.01 * c.rain + 0.01 * c.snow
    return replace(physical, extinction_per_m=total or AIR_PER_M, friction=_FILM_FRICTION[0])


def _steady(value: float) -> float:
    return float(steady(value, 24))


def _through(intensity: float, light: float, heavy: float) -> float:
    """The power law through 0 at 0, ``light`` at 0.5 and ``heavy`` at 1."""
    return heavy * intensity ** math.log2(heavy / light)


def _intensity(value: float, light: float, heavy: float) -> float:
    """The intensity, at most 1, at which :func:`_through` gives a value."""
    return min(1.0, _steady((value / heavy) ** (1.0 / math.log2(heavy / light))))


def _fog_per_m(intensity: float) -> float:
    light, heavy = (MOR_PER_EXTINCTION / mor_m - AIR_PER_M for mor_m in _FOG_MOR_M)
    return _through(intensity, light, heavy)


def _snow_per_m(intensity: float) -> float:
    light, heavy = (VISIBILITY_PER_EXTINCTION / v_m - AIR_PER_M for v_m in _SNOW_VISIBILITY_M)
    return _through(intensity, light, heavy)


def _snowfall_per_m(mm_per_h: float) -> float:
    return 5.53 * float(mm_per_h**1.38) * _DB_PER_KM


def _rain_per_m(mm_per_h: float) -> float:
    return (1.0 + _MIST_SHARE) * 1.076 * mm_per_h**0.67 * _DB_PER_KM


def _table(intensity: float, values: tuple[float, float, float]) -> float:
    return float(np.interp(intensity, _STEPS, values))


WEATHER: dict[str, WeatherParameters] = {n: parameters(c) for n, c in PRESETS.items()}
"""The presets of the physical family."""

WEATHER_AUTODRIVE: dict[str, WeatherParameters] = {
    n: replace(parameters(c, "autodrive"), wind_mps=0.0, gust_mps=0.0) for n, c in PRESETS.items()
}
"""The presets of AutoDRIVE's family."""

FAMILIES = {"physical": WEATHER, "autodrive": WEATHER_AUTODRIVE}
"""Presets by family."""
