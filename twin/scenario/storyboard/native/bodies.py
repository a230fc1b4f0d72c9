"""Kinds of actors: size, weight, and what they can do.

Cars, vans, trucks and buses have the size of the bodies that the project draws for them. Persons
are those of proving grounds: an adult of 1.8 m and a child of 1.154 m (ISO 19206-2), a bicycle with
its rider 1.9 m long (ISO 19206-4). The animal is a roe deer. Accelerations are what such vehicles
reach on dry asphalt, in round numbers; they limit driver models and changes of speed.
"""

from __future__ import annotations

from dataclasses import dataclass

from twin.scenario.storyboard.native.sections import ActorStart
from twin.scenario.storyboard.program.entities import BodyBox, EntityCategory, StoryboardEntity
from twin.scenario.storyboard.program.places import FixedPosition


@dataclass(frozen=True, slots=True)
class ActorBody:
    """What a kind of actor is like."""

    category: EntityCategory
    length_m: float
    width_m: float
    height_m: float
    mass_kg: float
    speed_max_mps: float
    acceleration_max_mps2: float
    deceleration_max_mps2: float
    wheelbase_m: float = 0.0
    rear_m: float | None = None
    """From the rear end to the rear axle, which is the origin; None: the origin is in the
    middle."""
    coupler_m: float = 0.0
    """From the axle of a trailer to its coupler, which lies before its box; 0: it is none."""

    @property
    def centre_x_m(self) -> float:
        """From the origin to the middle of the box."""
        return 0.0 if self.rear_m is None else 0.5 * self.length_m - self.rear_m

    @property
    def hitch_x_m(self) -> float | None:
        """From the origin to where it tows a trailer; None: it has no hitch."""
        return None if self.rear_m is None else -self.rear_m - HITCH_M


BODIES = {
    "car": ActorBody(EntityCategory.CAR, 4.5, 1.8, 1.46, 1500.0, 70.0, 5.0, 10.0, 2.69, 0.83),
    "van": ActorBody(EntityCategory.VAN, 5.2, 1.96, 2.12, 2200.0, 50.0, 3.5, 9.0, 3.25, 0.95),
    "truck": ActorBody(EntityCategory.TRUCK, 7.2, 2.3, 3.2, 7500.0, 30.0, 2.0, 7.0, 4.8, 1.35),
    "trailer": ActorBody(
        EntityCategory.TRAILER, 7.2, 2.4, 3.2, 8000.0, 30.0, 2.0, 7.0, 0.0, 2.16, coupler_m=6.24
    ),
    "bus": ActorBody(EntityCategory.BUS, 11.8, 2.5, 3.1, 12000.0, 30.0, 1.5, 6.0, 6.0, 3.2),
    "motorcycle": ActorBody(EntityCategory.MOTORCYCLE, 2.2, 0.8, 1.5, 280.0, 70.0, 7.0, 9.0),
    "bicycle": ActorBody(EntityCategory.BICYCLE, 1.9, 0.6, 1.8, 95.0, 15.0, 3.0, 5.0),
    "pedestrian": ActorBody(EntityCategory.PEDESTRIAN, 0.6, 0.6, 1.8, 80.0, 8.0, 5.0, 5.0),
    "child": ActorBody(EntityCategory.CHILD, 0.5, 0.5, 1.154, 25.0, 6.0, 5.0, 5.0),
    "animal": ActorBody(EntityCategory.ANIMAL, 1.2, 0.4, 1.0, 25.0, 18.0, 8.0, 8.0),
    "obstacle": ActorBody(EntityCategory.OBSTACLE, 1.0, 1.0, 1.0, 100.0, 70.0, 5.0, 10.0),
}
"""Bodies by kind; a trailer's drawbar is 1.2 m long."""
HITCH_M = 0.15
"""How far behind its rear end a vehicle tows [m]."""
WALKERS = frozenset({"pedestrian", "child", "animal"})
"""Kinds without lamps and driver models."""


def body_of(start: ActorStart) -> ActorBody:
    """The body of an actor with the measures that its file gives."""
    kind = BODIES[start.kind]
    length = start.length_m or kind.length_m
    stretch = length / kind.length_m
    return ActorBody(
        kind.category,
        length,
        start.width_m or kind.width_m,
        start.height_m or kind.height_m,
        kind.mass_kg,
        kind.speed_max_mps,
        kind.acceleration_max_mps2,
        kind.deceleration_max_mps2,
        kind.wheelbase_m * stretch,
        None if kind.rear_m is None else kind.rear_m * stretch,
        kind.coupler_m * stretch,
    )


def entity_of(
    name: str,
    kind: str,
    body: ActorBody,
    place: FixedPosition,
    *,
    ego: bool = False,
    tractor: int = -1,
) -> StoryboardEntity:
    """The entity of an actor that starts at ``place``, where its origin is, behind its tractor."""
    return StoryboardEntity(
        name=name,
        category=body.category,
        box=BodyBox(
            centre_x_m=body.centre_x_m,
            centre_y_m=0.0,
            centre_z_m=0.5 * body.height_m,
            length_m=body.length_m,
            width_m=body.width_m,
            height_m=body.height_m,
        ),
        speed_max_mps=body.speed_max_mps,
        acceleration_max_mps2=body.acceleration_max_mps2,
        deceleration_max_mps2=body.deceleration_max_mps2,
        wheelbase_m=body.wheelbase_m,
        mass_kg=body.mass_kg,
        ego=ego,
        catalog_entry=kind,
        start=place,
        hitch_x_m=body.hitch_x_m,
        coupler_x_m=body.coupler_m or None,
        tractor=tractor,
    )
