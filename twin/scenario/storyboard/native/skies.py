"""Weather, hour and road of an event become an environment of the program."""

from __future__ import annotations

from schemas.names import minutes
from twin.scenario.storyboard.native.sections import StoryEvent
from twin.scenario.storyboard.program.program import StoryboardEnvironment
from twin.world.sky.weather import (
    AIR_PER_M,
    MOR_PER_EXTINCTION,
    WEATHER,
    fog_extinction_per_m,
)


def environment_of(name: str, event: StoryEvent) -> StoryboardEnvironment | None:
    """What an event changes of weather, hour and road; None: nothing.

    Args:
        name: of the event.
    """
    if not event.changes_sky:
        return None
    minute = None if event.time_of_day is None else float(minutes(event.time_of_day))
    values: dict[str, float] = {}
    if event.weather is not None:
        weather = WEATHER[event.weather]
        values = {
            "cloud_fraction": weather.cloud_cover,
            "fog_visual_range_m": MOR_PER_EXTINCTION / (fog_extinction_per_m(weather) + AIR_PER_M),
            "rain_mm_per_h": weather.rain_mm_per_h,
            "snow_mm_per_h": weather.snow_mm_per_h,
            "wind_speed_mps": weather.wind_mps,
        }
    return StoryboardEnvironment(
        name, minute_of_day=minute, friction_factor=event.friction_factor, **values
    )
