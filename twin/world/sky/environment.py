"""A case's weather and light at any moment of its sim time."""

from __future__ import annotations

import math

from schemas.case import Case
from schemas.names import minutes
from schemas.sections.environment import Change, Environment
from schemas.wire.interventions import SetEnvironment
from twin.world.sky.almanac import EarthPlace, heavens
from twin.world.sky.scripted import ScriptedEnvironment
from twin.world.sky.sun import Daylight, daylight_under
from twin.world.sky.weather import (
    WeatherParameters,
    blended,
    overridden,
    parameters,
    weather_of,
)

_DAY_MIN = 1440.0


class CaseEnvironment:
    """Weather and light of a case over a scene's ``origin``.

    Between changes nothing moves but clouds and wind: a case is too short for the sun. A change
    runs on straight lines, in every parameter of the weather and in the clock.
    """

    def __init__(self, case: Case, origin: EarthPlace) -> None:
        """Work out the environment of a case.

        Raises:
            ValueError: the case's weather is neither a preset nor one of its own; one line.
        """
        self._environment = case.variation.environment
        self._place = origin
        self._weathers = {
            name: self._weather(name)
            for name in {
                case.variation.weather,
                *(c.weather for c in case.variation.environment.timeline),
            }
            - {None}
        }
        self._first = self._weathers[case.variation.weather]
        self._minute = float(case.variation.time_of_day_min)
        self._last: tuple[float, WeatherParameters, ScriptedEnvironment | None] | None = None
        self._scripted: ScriptedEnvironment | None = None
        self._light: Daylight | None = None
        self._chosen_weather: WeatherParameters | None = None
        self._chosen_minute: float | None = None
        self.shown = case.variation.weather
        """Name of the weather now; empty: intensities that an intervention or a scenario set."""

    def script(self, scripted: ScriptedEnvironment | None) -> None:
        """Weather, clock and road as the scenario has them from now on, in place of what the case
        says; an intervention goes before it. None: the scenario says nothing."""
        self._scripted = scripted
        if scripted is not None and scripted.changes_air and self._chosen_weather is None:
            self.shown = ""

    def override(self, change: SetEnvironment) -> None:
        """Weather and clock as an intervention sets them, from now on and whatever the timeline
        says.

        Raises:
            ValueError: no such weather; one line.
        """
        found = self.check(change)
        if found is not None:
            self._chosen_weather = found
            self.shown = change.weather
        if change.time_of_day_min is not None:
            self._chosen_minute = change.time_of_day_min

    def check(self, change: SetEnvironment) -> WeatherParameters | None:
        """The weather that :meth:`override` would bring; None: it stays.

        Raises:
            ValueError: no such weather; one line.
        """
        own = self._environment
        if change.weather:
            return self._weather(change.weather)
        if change.conditions is not None:
            return overridden(parameters(change.conditions, own.family), own.friction, own.water_mm)
        return None

    def clock_min(self, time_ns: int) -> float:
        """Local time at a sim time [minutes after midnight]."""
        return self._clock(time_ns / 1e9) % _DAY_MIN

    @property
    def changes(self) -> bool:
        """Whether there is anything to ask for again while the case runs."""
        return bool(self._environment.timeline)

    @property
    def wind_towards(self) -> tuple[float, float]:
        """Direction in which the wind blows, unit vector in the world frame."""
        scripted = None if self._scripted is None else self._scripted.wind_towards
        return scripted or wind_towards(self._environment, self._place)

    def at(self, time_ns: int) -> tuple[WeatherParameters, Daylight]:
        """Weather and light at a sim time; cheap while nothing changes."""
        time_s = time_ns / 1e9
        now = (self._clock(time_s), self._weather_at(time_s), self._sky)
        if self._light is None or now != self._last:
            self._light = light_of(self._environment, self._place, *now)
            self._last = now
        return now[1], self._light

    def _weather(self, name: str) -> WeatherParameters:
        environment = self._environment
        found = weather_of(name, environment)
        return overridden(found, environment.friction, environment.water_mm)

    def _weather_at(self, time_s: float) -> WeatherParameters:
        if self._chosen_weather is not None:
            return self._chosen_weather
        if self._scripted is None:
            return self._planned(time_s)
        own = self._environment
        weather = self._scripted.weather(self._planned(time_s), own.family)
        return self._scripted.on_road(overridden(weather, own.friction, own.water_mm))

    @property
    def _sky(self) -> ScriptedEnvironment | None:
        """What the scenario says of sun and clock, unless an intervention has set the clock."""
        return self._scripted if self._chosen_minute is None else None

    def _planned(self, time_s: float) -> WeatherParameters:
        """The weather that the case says."""
        weather = self._first
        for change in self._environment.timeline:
            if change.weather is None or change.at_s > time_s:
                continue
            share = _progress(change, time_s)
            target = self._weathers[change.weather]
            weather = target if share >= 1.0 else blended(weather, target, share)
        return weather

    def _clock(self, time_s: float) -> float:
        if self._chosen_minute is not None:
            return self._chosen_minute
        if self._scripted is not None and self._scripted.minute is not None:
            return self._scripted.minute
        minute = self._minute
        for change in self._environment.timeline:
            if change.time_of_day is None or change.at_s > time_s:
                continue
            forward = (minutes(change.time_of_day) - minute) % _DAY_MIN
            minute += forward * _progress(change, time_s)
        return minute


def light_of(
    environment: Environment,
    place: EarthPlace,
    minute: float,
    weather: WeatherParameters,
    scripted: ScriptedEnvironment | None = None,
) -> Daylight:
    """Light at a local time [minutes after the first midnight] under ``weather``; ``scripted``:
    what a scenario says of sun and day."""
    heavens_of = heavens if scripted is None else scripted.heavens
    bodies = heavens_of(place, environment.date, minute, environment.sun)
    return daylight_under(bodies, weather, environment.exposure_ev100)


def wind_towards(environment: Environment, place: EarthPlace) -> tuple[float, float]:
    """Direction in which the wind blows, unit vector in the world frame, x and y."""
    turn = math.radians(environment.wind_from_deg - place.heading_deg)
    return round(-math.cos(turn), 9), round(math.sin(turn), 9)  # the same on every host


def _progress(change: Change, time_s: float) -> float:
    if change.over_s <= 0.0:
        return 1.0
    return min(1.0, (time_s - change.at_s) / change.over_s)
