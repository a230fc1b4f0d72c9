"""Movable objects of running cases: their scripts as the cases vary them, and those that an
intervention has taken off."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from schemas.sections.objects import ObjectVariation
from schemas.wire.interventions import (
    FreeObject,
    MoveObject,
    ObjectState,
    RemoveObject,
    SpawnObject,
)
from twin.actors.motion import InterventionTarget, Motion, ObjectKind, Placement
from twin.actors.variations import Variations

ObjectAction = MoveObject | SpawnObject | RemoveObject | FreeObject


@dataclass(frozen=True, slots=True)
class _Placed:
    """Straight ahead from a place, from a sim time on."""

    kind: int
    """-1: taken away."""
    position_m: tuple[float, float, float]
    yaw_rad: float
    speed_mps: float
    since_s: float


class InterventionMotion:
    """A script with exceptions, per slot; without any it costs nothing."""

    def __init__(
        self,
        script: Motion,
        kinds: tuple[ObjectKind, ...],
        slots: int,
        bodies: InterventionTarget | None = None,
    ) -> None:
        """``bodies``: the same as ``script`` where a scenario moves all of them."""
        self.count = script.count
        self.standing = script.standing
        self._varied = Variations(script.actors, slots)
        self._script = script
        self._kinds = kinds
        self._bodies = bodies
        self._placed: dict[int, dict[int, _Placed]] = {}

    def begin(self, slot: int, objects: Mapping[str, ObjectVariation]) -> None:
        """A case begins in a slot.

        Raises:
            ValueError: the scene has no such object, or it cannot be varied so; one line.
        """
        self._placed.pop(slot, None)
        self._varied.begin(slot, objects)

    def clear(self, slot: int) -> None:
        """All objects of a slot follow their script, as the scene says."""
        self._placed.pop(slot, None)
        self._varied.clear(slot)

    def at(self, time_s: np.ndarray) -> Placement:
        """See :class:`twin.actors.motion.Motion`; ``time_s`` of all slots."""
        placement = self._script.at(time_s, self._varied)
        for slot, objects in self._placed.items():
            for index, placed in objects.items():
                _put(placement, slot, index, placed, float(time_s[slot]))
        return placement

    def hulls(self, time_s: np.ndarray, sizes_m: np.ndarray) -> np.ndarray:
        """What vehicles may hit of it, see :meth:`twin.actors.motion.Placement.hulls`; bodies of a
        scenario say it without how they look."""
        if self._bodies is not None:
            return self._bodies.hulls()
        return self.at(time_s).hulls(sizes_m)

    def act(self, slot: int, action: ObjectAction, time_s: np.ndarray) -> int:
        """Carry out an action at the slots' sim times; the object it was done to.

        Raises:
            ValueError: no such object or kind, or none to spare; one line.
        """
        if self._bodies is not None:
            return self._bodies.act(slot, action)
        if isinstance(action, SpawnObject):
            index = self._spare(slot, action.kind, time_s)
        else:
            index = action.object
        if not 0 <= index < self.count:
            allowed = f"0 to {self.count - 1}" if self.count else "none, nothing moves in it"
            raise ValueError(f"object: given {index}, the scene has {allowed}")
        objects = self._placed.setdefault(slot, {})
        if isinstance(action, FreeObject):
            objects.pop(index, None)
            return index
        since_s = float(time_s[slot])
        if isinstance(action, RemoveObject):
            objects[index] = _Placed(-1, (0.0, 0.0, 0.0), 0.0, 0.0, since_s)
            return index
        place = (action.x_m, action.y_m, action.z_m)
        kind = int(self.standing[index])
        objects[index] = _Placed(kind, place, action.yaw_rad, action.speed_mps, since_s)
        return index

    def states(self, slot: int, time_s: np.ndarray) -> list[ObjectState]:
        """All objects of a slot."""
        placement = self.at(time_s)
        moved = frozenset(self._placed.get(slot, ()))
        if self._bodies is not None:
            moved = self._bodies.moved(slot)
        return [
            ObjectState(
                object=index,
                kind=self._name(index, int(placement.kind[slot, index])),
                present=bool(placement.kind[slot, index] >= 0),
                x_m=float(placement.position_m[slot, index, 0]),
                y_m=float(placement.position_m[slot, index, 1]),
                yaw_rad=float(placement.yaw_rad[slot, index]),
                by_hand=index in moved,
            )
            for index in range(self.count)
            if self._script.actors or placement.kind[slot, index] >= 0 or index in moved
        ]

    def _name(self, index: int, now: int = -1) -> str:
        """Name of an object's kind; of one that no scene knows, of what it is ``now``."""
        if self._script.actors or now < 0:
            return self._kinds[int(self.standing[index])].name
        return self._kinds[now].name.partition(" phase")[0]

    def _spare(self, slot: int, kind: str, time_s: np.ndarray) -> int:
        """The first object of a kind that is not there.

        What a slot may hold was decided when its rig was built: each object has its own place in
        the boxes and pictures, so nothing can be added, only brought in.
        """
        there = self.at(time_s).kind[slot] >= 0
        alike = [index for index in range(self.count) if self._name(index) == kind]
        if not alike:
            kinds = sorted({self._name(index) for index in range(self.count)})
            raise ValueError(
                f"kind: given '{kind}', the scene has {', '.join(kinds) or 'nothing that moves'}"
            )
        for index in alike:
            if not there[index]:
                return index
        raise ValueError(
            f"no {kind} to spare: all {len(alike)} of the scene are there; move or remove one"
        )


def _put(placement: Placement, slot: int, index: int, placed: _Placed, now_s: float) -> None:
    x_m, y_m, z_m = placed.position_m
    vx, vy = (placed.speed_mps * f(placed.yaw_rad) for f in (math.cos, math.sin))
    since_s = now_s - placed.since_s
    placement.kind[slot, index] = placed.kind
    placement.position_m[slot, index] = (x_m + vx * since_s, y_m + vy * since_s, z_m)
    placement.yaw_rad[slot, index] = placed.yaw_rad
    placement.velocity_mps[slot, index] = (vx, vy, 0.0)
    placement.yaw_rate_radps[slot, index] = 0.0
    for tilt_rad in (placement.pitch_rad, placement.roll_rad):
        if tilt_rad is not None:
            tilt_rad[slot, index] = 0.0
    placement.brake[slot, index] = 0.0
