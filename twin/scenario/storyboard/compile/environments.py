"""Environments: weather, light and the state of the road."""

from __future__ import annotations

import math

from twin.scenario.storyboard.compile.context import (
    Compilation,
    Handler,
    RefusalError,
    number_of,
    seconds_of,
)
from twin.scenario.storyboard.openscenario.element import ScenarioElement
from twin.scenario.storyboard.program.program import ENVIRONMENT_LIMITS, StoryboardEnvironment
from twin.world.sky.weather import rain_at, snowfall_at

_OKTAS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight")
_CLOUDS = {"free": 0.0, "cloudy": 0.5, "overcast": 1.0, "rainy": 1.0}
"""Shares of the sky for the words of versions before 1.2."""


_FILMS_MM = {
    "dry": 0.0,
    "moist": 0.2,
    "wetWithPuddles": 1.0,
    "lowFlooded": 5.0,
    "highFlooded": 10.0,
}
"""Water on a road for the words of its wetness."""


def _environment(element: ScenarioElement, context: Compilation) -> StoryboardEnvironment:
    values: dict[str, float] = {}
    time = element.first("TimeOfDay")
    if time is not None:
        date_time = str(time.values["dateTime"])
        values["time_of_day_s"] = seconds_of(date_time)
        values["clock_s"] = seconds_of(date_time, zone=False)
        if time.values["animation"]:
            context.note(time, "the clock goes on, the picture of the sky stays")
    weather = element.first("Weather")
    if weather is not None:
        values |= _weather(weather, context)
    road = element.first("RoadCondition")
    if road is not None:
        values["friction_factor"] = float(road.values["frictionScaleFactor"])
        if "wetness" in road.values:
            values["water_mm"] = _FILMS_MM[str(road.values["wetness"])]
    for key, value in values.items():
        low, high = ENVIRONMENT_LIMITS.get(key, (-math.inf, math.inf))
        if not low <= value <= high:
            words = key.replace("_", " ")
            raise RefusalError(element, f"{words} is {value:g}, allowed: {low:g} to {high:g}")
    return StoryboardEnvironment(element.label, **values)


def _weather(element: ScenarioElement, context: Compilation) -> dict[str, float]:
    values: dict[str, float] = {}
    clouds = _clouds(element)
    if clouds is not None:
        values["cloud_fraction"] = clouds
    if "temperature" in element.values:
        values["temperature_k"] = float(element.values["temperature"])
    for child in element.children:
        if child.type_name in _PARTS:
            values |= _PARTS[child.type_name](child)
            if child.type_name == "Fog" and child.first("BoundingBox") is not None:
                context.note(child, "the fog is everywhere, not in its BoundingBox alone")
    return values


def _clouds(element: ScenarioElement) -> float | None:
    if "fractionalCloudCover" in element.values:
        word = str(element.values["fractionalCloudCover"]).removesuffix("Oktas")
        # Nine oktas: the sky cannot be seen, for fog or snow.
        return min(_OKTAS.index(word), 8) / 8.0 if word in _OKTAS else 1.0
    return _CLOUDS.get(str(element.values.get("cloudState", "")))


def _sun(element: ScenarioElement) -> dict[str, float]:
    illuminance = number_of(element, "illuminance", number_of(element, "intensity", -1.0))
    values = {
        "sun_azimuth_rad": float(element.values["azimuth"]),
        "sun_elevation_rad": float(element.values["elevation"]),
    }
    return values | ({"sun_illuminance_lx": illuminance} if illuminance >= 0.0 else {})


def _fog(element: ScenarioElement) -> dict[str, float]:
    high = ENVIRONMENT_LIMITS["fog_visual_range_m"][1]
    return {"fog_visual_range_m": min(float(element.values["visualRange"]), high)}


def _precipitation(element: ScenarioElement) -> dict[str, float]:
    """Rates [mm/h]; version 1.0 gives an intensity from 0 to 1 instead."""
    share = min(1.0, max(0.0, number_of(element, "intensity", 0.0)))
    kind = element.values["precipitationType"]
    rain = number_of(element, "precipitationIntensity", rain_at(share))
    snow = number_of(element, "precipitationIntensity", snowfall_at(share))
    return {
        "rain_mm_per_h": rain if kind == "rain" else 0.0,
        "snow_mm_per_h": snow if kind == "snow" else 0.0,
    }


def _wind(element: ScenarioElement) -> dict[str, float]:
    return {
        "wind_direction_rad": float(element.values["direction"]),
        "wind_speed_mps": float(element.values["speed"]),
    }


_PARTS = {"Sun": _sun, "Fog": _fog, "Precipitation": _precipitation, "Wind": _wind}

ENVIRONMENTS: dict[str, Handler] = {"Environment": _environment}
"""Handlers of environments by element type."""
