"""Entities of a storyboard program."""

from __future__ import annotations

from enum import IntEnum

from twin.scenario.storyboard.program.places import FixedPosition
from twin.scenario.storyboard.program.record import ProgramRecord


class EntityCategory(IntEnum):
    """What a body is; looks and conditions on types of objects depend on it."""

    CAR = 0
    VAN = 1
    TRUCK = 2
    TRAILER = 3
    SEMITRAILER = 4
    BUS = 5
    MOTORCYCLE = 6
    BICYCLE = 7
    TRAIN = 8
    TRAM = 9
    PEDESTRIAN = 10
    CHILD = 11
    WHEELCHAIR = 12
    ANIMAL = 13
    OBSTACLE = 14
    """Any other object."""


class BodyBox(ProgramRecord, frozen=True):
    """Bounding box in the axes of its entity: origin on the ground, x forwards, y to the left."""

    centre_x_m: float
    centre_y_m: float
    centre_z_m: float
    length_m: float
    width_m: float
    height_m: float


class StoryboardEntity(ProgramRecord, frozen=True):
    """One entity."""

    name: str
    category: EntityCategory
    box: BodyBox
    speed_max_mps: float
    acceleration_max_mps2: float
    deceleration_max_mps2: float
    wheelbase_m: float
    """Distance of front and rear axle; 0 where there are none."""
    mass_kg: float
    ego: bool
    """Driven by what is tested, or by the robot in its place."""
    catalog_entry: str = ""
    """For looks."""
    start: FixedPosition | None = None
    """None: somewhere else, invisible, until an action places it."""
    hitch_x_m: float | None = None
    """Where it tows trailers, forwards from its origin; None: it tows none."""
    coupler_x_m: float | None = None
    """Where it is towed, forwards from its origin, the middle of its axle; None: it is not."""
    tractor: int = -1
    """Entity whose hitch it hangs on at the beginning; -1: none."""
