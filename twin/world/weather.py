"""Weather: one physical parameter set that drives optics and tyre friction together."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class WeatherParameters:
    """What a weather means physically."""

    extinction_per_m: float
    """Extinction of visible light, the inverse of the mean free path [1/m], >= 0."""
    cloud_cover: float
    """Share of the sky under thick cloud [-], 0..1; from 0.6 on the sun casts no shadow."""
    sky_factor: float
    """Daylight that is left below the clouds' rain or snow [-], 0..1."""
    rain: float
    """Rain intensity [-], 0 none, 1 heavy."""
    snow: float
    """Snow intensity [-], 0 none, 1 heavy."""
    wetness: float
    """Water on the road [-], 0 dry, 1 a closed film."""
    snow_cover: float
    """Share of open ground under snow [-], 0..1."""
    friction: float
    """Tyre-road friction coefficient [-]."""


def _mean_free_path(length_m: float) -> float:
    return 1.0 / length_m


# Mean free paths of fog, rain and snow are those of AutoDRIVE's presets; clear air has a
# meteorological visibility V = 3.912 / b of 39 km (clear) and 20 km (cloudy).
# Friction: new tyres at 50 km/h after the Bosch Automotive Handbook: dry 0.85, water film 0.2 mm
# 0.65, 1 mm 0.55, packed snow 0.20-0.35. Fog is taken as dry road.
_DRY, _FILM_0_2_MM, _FILM_1_MM, _SNOW_LOOSE, _SNOW_PACKED = 0.85, 0.65, 0.55, 0.35, 0.20

WEATHER: dict[str, WeatherParameters] = {
    "clear": WeatherParameters(1.0e-4, 0.15, 1.0, 0.0, 0.0, 0.0, 0.0, _DRY),
    "cloudy": WeatherParameters(2.0e-4, 0.85, 1.0, 0.0, 0.0, 0.0, 0.0, _DRY),
    "light_fog": WeatherParameters(_mean_free_path(150), 0.7, 0.9, 0.0, 0.0, 0.15, 0.0, _DRY),
    "heavy_fog": WeatherParameters(_mean_free_path(50), 0.9, 0.75, 0.0, 0.0, 0.25, 0.0, _DRY),
    "light_rain": WeatherParameters(
        _mean_free_path(200), 0.8, 0.8, 0.35, 0.0, 0.6, 0.0, _FILM_0_2_MM
    ),
    "heavy_rain": WeatherParameters(_mean_free_path(100), 1.0, 0.5, 1.0, 0.0, 1.0, 0.0, _FILM_1_MM),
    "light_snow": WeatherParameters(
        _mean_free_path(200), 0.8, 0.9, 0.0, 0.35, 0.3, 0.55, _SNOW_LOOSE
    ),
    "heavy_snow": WeatherParameters(
        _mean_free_path(100), 1.0, 0.7, 0.0, 1.0, 0.3, 0.95, _SNOW_PACKED
    ),
}
"""Parameters of the presets of :data:`schemas.campaign.Weather`."""

SHADOW_CLOUD_COVER_MAX = 0.6
"""From this cloud cover on the sun casts no shadow [-]."""
