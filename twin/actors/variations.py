"""What differs per slot of the scripts of a scene's objects: speed, start, and a sideways shift."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from schemas.sections.objects import ObjectVariation
from schemas.validation import suggest
from twin.actors.actor import Actor


class Variations:
    """Variations of M objects in S slots; as the scene says until :meth:`begin`."""

    def __init__(self, actors: Sequence[Actor], slots: int) -> None:
        self._actors = actors
        self._usual_s = np.array([actor.start_s for actor in actors], float)
        self.start_s = np.tile(self._usual_s, (slots, 1))
        """When each object sets off, sim time [S, M] [s]."""
        self.pace = np.ones((slots, len(actors)))
        """Factor of the scene's speeds [S, M] [-]."""
        self.shift_m = np.zeros((slots, len(actors), 2))
        """Shift from the scene's path to this one, world x and y [S, M, 2] [m]."""

    def begin(self, slot: int, objects: Mapping[str, ObjectVariation]) -> None:
        """The objects of a slot are those of a case.

        Raises:
            ValueError: the scene has no such object, or it cannot be varied so; one line.
        """
        self.clear(slot)
        for name, variation in objects.items():
            index = find_object(self._actors, name)
            actor = self._actors[index]
            try:
                self.pace[slot, index] = actor.pace_of(variation.speed_mps)
                if variation.start_s is not None:
                    self.start_s[slot, index] = actor.started(variation.start_s)
            except ValueError as error:
                raise ValueError(f"objects.{name}: {error}") from None
            self.shift_m[slot, index] = actor.sideways(variation.offset_m)

    def clear(self, slot: int) -> None:
        """The objects of a slot are those of the scene."""
        self.start_s[slot] = self._usual_s
        self.pace[slot] = 1.0
        self.shift_m[slot] = 0.0


def find_object(actors: Sequence[Actor], name: str) -> int:
    """Index of the object that the scene calls so.

    Raises:
        ValueError: none, or several; one line.
    """
    names = [actor.name for actor in actors]
    if name and names.count(name) == 1:
        return names.index(name)
    if name and name in names:
        raise ValueError(f"objects.{name}: the scene has several of this name; name each once")
    known = sorted({known for known in names if known})
    hint = suggest(name, known) if known else "it has none with a name"
    raise ValueError(f"objects.{name}: the scene has no object of this name; {hint}")
