"""What a campaign file says about weather and light: families, custom weathers, a timeline."""

from __future__ import annotations

import datetime
from typing import Annotated, Literal

from msgspec import UNSET, Meta, Struct, UnsetType

from schemas.names import WEATHERS, Name, TimeOfDay
from schemas.validation import Mistake, suggest

Intensity = Annotated[float, Meta(ge=0, le=1)]

CHANGES_MAX = 256
"""Largest number of changes in one timeline."""


class _Spec(Struct, frozen=True, forbid_unknown_fields=True):
    """Base of environment types: frozen, unknown keys are errors."""


class Conditions(_Spec, frozen=True):
    """A weather of one's own: intensities that may be combined; 0.5 is light, 1 heavy."""

    cloud: Intensity = 0.0
    """Share of the sky under cloud [-]."""
    fog: Intensity = 0.0
    """Fog: 0 none, 0.5 as thick as `light_fog`, 1 as `heavy_fog`, in extinction [-]."""
    rain: Intensity = 0.0
    """Rain: 0 none, 0.5 as hard as `light_rain`, 1 as `heavy_rain` [-]."""
    snow: Intensity = 0.0
    """Snow: 0 none, 0.5 as dense as `light_snow`, 1 as `heavy_snow` [-]."""
    wind: Intensity = 0.0
    """Wind: 0 calm, 1 a strong gale: Beaufort number over 9 [-]."""


class Change(_Spec, frozen=True, kw_only=True):
    """What changes while a case runs."""

    at_s: Annotated[float, Meta(ge=0, le=3600)]
    """When it begins, sim time [s]."""
    over_s: Annotated[float, Meta(ge=0, le=3600)] = 0.0
    """How long it takes; 0: at once [s]."""
    weather: Name | None = None
    """The weather afterwards: one of the eight, or one of `custom`."""
    time_of_day: TimeOfDay | None = None
    """Local time afterwards `HH:MM`; the clock runs forward to it."""

    def __post_init__(self) -> None:
        if self.weather is None and self.time_of_day is None:
            raise ValueError("nothing changes; give weather, time_of_day, or both")


class Environment(_Spec, frozen=True):
    """Weather, sun and what changes while a case runs."""

    family: Literal["physical", "autodrive"] = "physical"
    """`physical`: sight, rain rates and friction from the literature; `autodrive`: the mean free
    paths of AutoDRIVE's presets on a road that is always dry, for comparison with its runs."""
    sun: Literal["almanac", "autodrive"] = "almanac"
    """`almanac`: where it stands on that date at the scene's place; `autodrive`: it climbs 0.25
    degrees a minute, rises at 06:00 and stands overhead at noon."""
    date: Annotated[str, Meta(pattern=r"^[0-9]{4}-[0-9]{2}-[0-9]{2}\Z")] = "2025-03-20"
    """Day of sun and moon, `YYYY-MM-DD`."""
    wind_from_deg: Annotated[float, Meta(ge=0, lt=360)] = 270.0
    """Where the wind comes from, clockwise from north; 270 blows along the shipped street, so that
    a stack that does not steer stays in its lane [deg]."""
    exposure_ev100: Annotated[float, Meta(ge=-6, le=20)] | None = None
    """Exposure value of the cameras at ISO 100; null: automatic."""
    friction: Annotated[float, Meta(gt=0, le=1.5)] | None = None
    """Tyre-road friction whatever the weather; null: the weather's [-]."""
    water_mm: Annotated[float, Meta(ge=0, le=10)] | None = None
    """Water film on the road whatever the weather; null: the weather's [mm]."""
    cloud: Intensity | UnsetType = UNSET
    """Share of the sky under cloud whatever the weather; not given: the weather's [-]."""
    fog: Intensity | UnsetType = UNSET
    """Fog whatever the weather, in the unit of `custom`; not given: the weather's [-]."""
    rain: Intensity | UnsetType = UNSET
    """Rain whatever the weather, in the unit of `custom`; not given: the weather's [-]."""
    snow: Intensity | UnsetType = UNSET
    """Snow whatever the weather, in the unit of `custom`; not given: the weather's [-]."""
    wind: Intensity | UnsetType = UNSET
    """Wind whatever the weather, in the unit of `custom`; not given: the weather's [-]."""
    custom: dict[Name, Conditions] = {}
    """Weathers of one's own by name; the matrix axis `weather` may use them."""
    timeline: Annotated[list[Change], Meta(max_length=CHANGES_MAX)] = []
    """Changes while a case runs, in the order of their times."""

    def __post_init__(self) -> None:
        try:
            year = datetime.date.fromisoformat(self.date).year
        except ValueError:
            raise ValueError(
                f"date: given '{self.date}', which is no day; give YYYY-MM-DD"
            ) from None
        if not 1950 <= year <= 2100:
            raise ValueError(f"date: given '{self.date}', allowed: years 1950 to 2100")

    def intensities(self) -> dict[str, float]:
        """The intensities of :class:`Conditions` that hold whatever the weather."""
        given = {name: getattr(self, name) for name in Conditions.__struct_fields__}
        return {name: value for name, value in given.items() if value is not UNSET}

    def weathers(self) -> list[str]:
        """Every weather a case may have."""
        return [*WEATHERS, *self.custom]


def environment_mistakes(environment: Environment) -> list[Mistake]:
    """Names that clash or are unknown, and changes that are out of order or overlap."""
    mistakes = [
        Mistake(f"environment.custom.{name}", "the name of a shipped weather; choose another")
        for name in environment.custom
        if name in WEATHERS
    ]
    allowed = environment.weathers()
    for kind in ("weather", "time_of_day"):
        end_s, before = 0.0, -1
        for index, change in enumerate(environment.timeline):
            value = getattr(change, kind)
            if value is None:
                continue
            where = f"environment.timeline[{index}]"
            if kind == "weather" and value not in allowed:
                message = f"given {value!r}; {suggest(value, allowed)}"
                mistakes.append(Mistake(f"{where}.weather", message))
            if change.at_s < end_s:
                message = (
                    f"given {change.at_s:g}, but the change of {kind} [{before}] "
                    f"ends at {end_s:g}; give a later time"
                )
                mistakes.append(Mistake(f"{where}.at_s", message))
            end_s, before = change.at_s + change.over_s, index
    return mistakes
