"""The storyboard program: everything that a scenario does, ready to be packed for the kernel."""

from __future__ import annotations

from enum import IntEnum

from twin.road.opendrive.records import RoadNetwork
from twin.scenario.storyboard.program.actions import Action
from twin.scenario.storyboard.program.conditions import Trigger
from twin.scenario.storyboard.program.entities import StoryboardEntity
from twin.scenario.storyboard.program.places import RoadRoute, Trajectory
from twin.scenario.storyboard.program.record import ProgramRecord
from twin.scenario.storyboard.program.signals import SignalController


class ElementKind(IntEnum):
    """Level of a storyboard element."""

    STORYBOARD = 0
    STORY = 1
    ACT = 2
    GROUP = 3
    MANEUVER = 4
    EVENT = 5
    ACTION = 6


class EventPriority(IntEnum):
    """What an event that starts does to running ones of its maneuver."""

    PARALLEL = 0
    OVERRIDE = 1
    """Stops them."""
    SKIP = 2
    """Does not start while one runs."""


class StoryElement(ProgramRecord, frozen=True):
    """One element of the storyboard."""

    kind: ElementKind
    name: str
    parent: int
    """Index of the element it lies in; -1 of the storyboard itself."""
    line: int = 0
    """Where it stands in its file."""
    start: Trigger | None = None
    """Of acts and events; None: at once."""
    stop: Trigger | None = None
    """Of acts and the storyboard; None: never."""
    priority: EventPriority = EventPriority.PARALLEL
    executions_max: int = 1
    """Of groups and events."""
    actors: tuple[int, ...] = ()
    """Entities of a group."""
    triggering_actors: bool = False
    """The actors of a group are those that triggered the event, beside :attr:`actors`."""
    action: Action | None = None
    """Of action elements."""


class InitAction(ProgramRecord, frozen=True):
    """An action at the beginning, before the first step."""

    action: Action
    actor: int = -1
    """Entity; -1 of global actions."""


class ProgramVariable(ProgramRecord, frozen=True):
    """A variable, parameter, user-defined value or state of a signal, with its first value."""

    name: str
    value: float
    text: bool = False
    """Its values are numbers of words."""


class StoryboardEnvironment(ProgramRecord, frozen=True):
    """Weather, light and road of an environment; None: as before."""

    name: str
    time_of_day_s: float | None = None
    """Since 1970."""
    clock_s: float | None = None
    """The same moment as a clock at the place shows it, counted from 1970 as well."""
    minute_of_day: float | None = None
    """Local time without a date [minutes after midnight]."""
    cloud_fraction: float | None = None
    fog_visual_range_m: float | None = None
    rain_mm_per_h: float | None = None
    snow_mm_per_h: float | None = None
    """As water."""
    temperature_k: float | None = None
    sun_azimuth_rad: float | None = None
    """From north to the west."""
    sun_elevation_rad: float | None = None
    sun_illuminance_lx: float | None = None
    wind_direction_rad: float | None = None
    """Heading of the wind: where it blows to."""
    wind_speed_mps: float | None = None
    water_mm: float | None = None
    """Film on the road, as far as it is seen."""
    friction_factor: float | None = None


ENVIRONMENT_LIMITS: dict[str, tuple[float, float]] = {
    "clock_s": (-62_135_596_800.0, 253_402_300_799.0),
    "minute_of_day": (0.0, 1440.0),
    "cloud_fraction": (0.0, 1.0),
    "fog_visual_range_m": (0.0, 1e6),
    "rain_mm_per_h": (0.0, 1000.0),
    "snow_mm_per_h": (0.0, 1000.0),
    "temperature_k": (0.0, 1000.0),
    "sun_elevation_rad": (-1.5708, 1.5708),
    "sun_illuminance_lx": (0.0, 1e6),
    "wind_speed_mps": (0.0, 150.0),
    "water_mm": (0.0, 10.0),
    "friction_factor": (0.0, 100.0),
}
"""Lowest and highest values of an environment; a clock shows years 1 to 9999."""


class DriverModel(ProgramRecord, frozen=True):
    """IDM (Treiber, Hennecke, Helbing 2000, Phys. Rev. E 62) with MOBIL lane changes."""

    desired_speed_mps: float
    time_gap_s: float = 1.5
    gap_min_m: float = 2.0
    acceleration_mps2: float = 1.4
    deceleration_mps2: float = 2.0
    exponent: int = 4
    politeness: float = 0.3
    """Of lane changes; negative: never changes lanes."""
    change_threshold_mps2: float = 0.2
    deceleration_safe_mps2: float = 4.0
    change_duration_s: float = 4.0


class Program(ProgramRecord, frozen=True):
    """A whole scenario. Elements are in depth-first order, so a parent stands before its
    children; index 0 is the storyboard."""

    name: str
    entities: tuple[StoryboardEntity, ...]
    elements: tuple[StoryElement, ...]
    init: tuple[InitAction, ...]
    """In the order of the file."""
    trajectories: tuple[Trajectory, ...] = ()
    routes: tuple[RoadRoute, ...] = ()
    variables: tuple[ProgramVariable, ...] = ()
    words: tuple[str, ...] = ()
    environments: tuple[StoryboardEnvironment, ...] = ()
    models: tuple[DriverModel, ...] = ()
    network: RoadNetwork | None = None
    """The roads; None: open ground."""
    controllers: tuple[SignalController, ...] = ()
    """Of traffic signals."""
