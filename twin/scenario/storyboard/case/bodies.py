"""Bodies of one case: how they look, how large they are, and what they are called."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from twin.actors.palette import CLASS_OF, build_palette, class_index
from twin.scenario.storyboard.case.files import LoadedStoryboard
from twin.scenario.storyboard.program.entities import EntityCategory
from twin.world.things import Thing, named

_SORTS = {
    EntityCategory.CAR: "car",
    EntityCategory.VAN: "van",
    EntityCategory.TRUCK: "truck",
    EntityCategory.TRAILER: "trailer",
    EntityCategory.SEMITRAILER: "trailer",
    EntityCategory.BUS: "bus",
    EntityCategory.MOTORCYCLE: "motorcycle",
    EntityCategory.BICYCLE: "bicycle",
    EntityCategory.TRAIN: "bus",
    EntityCategory.TRAM: "bus",
    EntityCategory.PEDESTRIAN: "pedestrian",
    EntityCategory.CHILD: "child",
    EntityCategory.WHEELCHAIR: "pedestrian",
    EntityCategory.ANIMAL: "animal",
    EntityCategory.OBSTACLE: "obstacle",
}
_LIT = ("car", "van", "truck", "trailer", "bus", "motorcycle", "bicycle")
"""Sorts with lamps."""


@dataclass(frozen=True, slots=True)
class CaseBodies:
    """The bodies of a case, arrays of as many rows as the rig has room for [M]."""

    count: int
    """How many there are; they come first."""
    entity: np.ndarray
    """Their entities, int64."""
    kind: np.ndarray
    """Kind of each at rest, int32."""
    phases: np.ndarray
    """Kinds behind it that show it moving, int64."""
    way_m: np.ndarray
    """Way in which these pass once."""
    half_m: np.ndarray
    """Half length and half width [M, 2]."""
    centre_m: np.ndarray
    """From the entity's origin to the middle of its box, forwards and to the left [M, 2]."""
    class_index: np.ndarray
    """int32, into :data:`schemas.messages.OBJECT_CLASSES`."""
    lit: np.ndarray
    """bool, it has lamps."""
    things: tuple[Thing, ...]


@cache
def _palette():  # type: ignore[no-untyped-def]
    return build_palette()


def bodies_of(loaded: LoadedStoryboard, room: int) -> CaseBodies:
    """The bodies of a scenario, in the order of its entities."""
    whole = np.zeros(room, np.int32)
    bodies = CaseBodies(
        count=len(loaded.bodies),
        entity=np.zeros(room, np.int64),
        kind=whole.copy(),
        phases=np.zeros(room, np.int64),
        way_m=np.ones(room),
        half_m=np.zeros((room, 2)),
        centre_m=np.zeros((room, 2)),
        class_index=whole.copy(),
        lit=np.zeros(room, np.bool_),
        things=(),
    )
    things = []
    for row, index in enumerate(loaded.bodies):
        entity = loaded.program.entities[index]
        box, sort = entity.box, _SORTS[EntityCategory(entity.category)]
        look = _palette().look(sort, (box.length_m, box.width_m, box.height_m), row)
        bodies.entity[row], bodies.kind[row], bodies.phases[row] = index, look.kind, look.phases
        bodies.way_m[row] = look.way_m
        bodies.half_m[row] = box.length_m / 2, box.width_m / 2
        bodies.centre_m[row] = box.centre_x_m, box.centre_y_m
        bodies.class_index[row], bodies.lit[row] = class_index(sort), sort in _LIT
        things.append(named(entity.name, CLASS_OF[sort] if sort != "obstacle" else sort))
    empty = (Thing(f"body {row + 1}", "none") for row in range(len(things), room))
    return _with_things(bodies, (*things, *empty))


def _with_things(bodies: CaseBodies, things: tuple[Thing, ...]) -> CaseBodies:
    names = [name for name in CaseBodies.__match_args__ if name != "things"]
    return CaseBodies(**{name: getattr(bodies, name) for name in names}, things=things)
