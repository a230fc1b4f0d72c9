"""Bodies of cases: how they look, how large they are, and what they are called."""

from __future__ import annotations

from functools import cache

import numpy as np

from twin.actors.palette import CLASS_OF, FLAT_M, build_palette, class_index
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
_LEANS = {
    "pedestrian": (0.0, 0.0),
    "child": (0.0, 0.0),
    "motorcycle": (1.0, 0.0),
    "bicycle": (1.0, 0.0),
}
"""Shares of a road's pitch and roll with which a sort leans: who walks stands upright, and who
rides holds its balance. Everybody else stands on four wheels or legs."""
STEEP_RAD = 0.35
"""No road is as steep: a body that leans more was put so, whatever it is."""


class SlotBodies:
    """The bodies of all slots: arrays [S, M], of which the first rows of a slot are there."""

    def __init__(self, slots: int, room: int) -> None:
        shape = slots, room
        self.room = room
        self.there = np.zeros(shape, np.bool_)
        """Whether the case has such a body."""
        self.entity = np.zeros(shape, np.int64)
        """Its entity."""
        self.kind = np.zeros(shape, np.int32)
        """Its kind at rest."""
        self.phases = np.zeros(shape, np.int64)
        """Kinds behind it that show it moving."""
        self.way_m = np.ones(shape)
        """Way in which these pass once."""
        self.half_m = np.zeros((*shape, 2))
        """Half length and half width."""
        self.centre_m = np.zeros((*shape, 2))
        """From the entity's origin to the middle of its box, forwards and to the left."""
        self.class_index = np.zeros(shape, np.int32)
        """Index into :data:`schemas.messages.OBJECT_CLASSES`."""
        self.leans = np.ones((*shape, 2))
        """Shares of its pitch and roll with which it stands on a road."""
        self.lit = np.zeros(shape, np.bool_)
        """Whether it has lamps."""

    def clear(self, slot: int) -> None:
        """Nobody is in a slot."""
        for rows in (self.there, self.entity, self.kind, self.phases, self.half_m):
            rows[slot] = 0
        self.centre_m[slot], self.class_index[slot], self.lit[slot] = 0.0, 0, False
        self.way_m[slot] = self.leans[slot] = 1.0

    def lean(self, pitch_rad: np.ndarray, roll_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pitch and roll of bodies [S, M] in pictures, of what stands on such a slope."""
        put = (np.abs(pitch_rad) > STEEP_RAD) | (np.abs(roll_rad) > STEEP_RAD)
        shares = np.where(put[..., None], 1.0, self.leans) * self.there[..., None]
        return pitch_rad * shares[..., 0], roll_rad * shares[..., 1]

    def begin(self, slot: int, loaded: LoadedStoryboard) -> tuple[Thing, ...]:
        """The bodies of a slot are those of a scenario, in the order of its entities; what they
        are called [M]."""
        self.clear(slot)
        things = []
        for row, index in enumerate(loaded.bodies):
            entity = loaded.program.entities[index]
            box, sort = entity.box, _SORTS[EntityCategory(entity.category)]
            look = _palette().look(sort, (box.length_m, box.width_m, box.height_m), row)
            at = slot, row
            self.there[at], self.entity[at], self.kind[at] = True, index, look.kind
            self.phases[at], self.way_m[at] = look.phases, look.way_m
            if box.height_m > FLAT_M:
                self.half_m[at] = box.length_m / 2, box.width_m / 2
            self.leans[at] = _LEANS.get(sort, (1.0, 1.0))
            self.centre_m[at] = box.centre_x_m, box.centre_y_m
            self.class_index[at], self.lit[at] = class_index(sort), sort in _LIT
            things.append(named(entity.name, CLASS_OF[sort] if sort != "obstacle" else sort))
        empty = (Thing(f"body {row + 1}", "none") for row in range(len(things), self.room))
        return (*things, *empty)


@cache
def _palette():  # type: ignore[no-untyped-def]
    return build_palette()
