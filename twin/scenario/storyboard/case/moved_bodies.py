"""Bodies of storyboards that an intervention has taken off them, in all slots of a rig."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schemas.wire.interventions import FreeObject, MoveObject, RemoveObject, SpawnObject
from twin.road.beside.bodies import body_axes
from twin.road.opendrive.grid import cosine, settled, sine
from twin.road.opendrive.road_map import RoadMap
from twin.scenario.storyboard.case.bodies import SlotBodies
from twin.scenario.storyboard.case.rig_player import RigPlayer
from twin.scenario.storyboard.player.columns import Real, Whole

BodyAction = MoveObject | SpawnObject | RemoveObject | FreeObject

AWAY_M = 1e6
"""Where bodies are that were taken away, from the world's origin: near nobody, on no road [m]."""


@dataclass(slots=True)
class _Moved:
    """Straight ahead from a place of the entity's origin."""

    x_m: float
    y_m: float
    z_m: float
    heading_rad: float
    speed_mps: float
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    away: bool = False
    """Whether it was taken away; its place is where it was then."""
    steps: int = 0
    """Steps since then."""


class MovedBodies:
    """What interventions have done to the bodies of all slots; without any it costs nothing.

    A body that was moved goes straight ahead at its speed, whatever the storyboard says, at the
    height of the road that it is on, and leans as that does. Everybody else reacts to it where it
    is. Given back, it goes on from there as the storyboard says.
    """

    def __init__(
        self, player: RigPlayer, bodies: SlotBodies, roads: RoadMap | None, step_s: float
    ) -> None:
        self._player = player
        self._bodies = bodies
        self._frames = tuple(roads.frames.values()) if roads else ()
        self._step_s = step_s
        self._moved: dict[int, dict[int, _Moved]] = {}

    def clear(self, slot: int) -> None:
        """Another case begins in a slot, or none."""
        self._moved.pop(slot, None)

    def rows(self, slot: int) -> frozenset[int]:
        """Bodies of a slot that are off the storyboard."""
        return frozenset(self._moved.get(slot, ()))

    def away(self) -> list[tuple[int, int]]:
        """Slot and body of those that were taken away."""
        return [
            (slot, row)
            for slot, bodies in self._moved.items()
            for row, moved in bodies.items()
            if moved.away
        ]

    def act(self, slot: int, action: BodyAction) -> int:
        """Carry out an action between two steps; the body it was done to.

        Raises:
            ValueError: no such body, or it cannot be done; one line.
        """
        if isinstance(action, SpawnObject):
            raise ValueError("spawn: the scenario of this case says who is there; move one of them")
        row = action.object
        if not 0 <= row < self._bodies.room or not self._bodies.there[slot, row]:
            count = int(self._bodies.there[slot].sum())
            allowed = f"0 to {count - 1}" if count else "none, nobody else is in it"
            raise ValueError(f"object: given {row}, the scenario of this case has {allowed}")
        bodies = self._moved.setdefault(slot, {})
        if isinstance(action, FreeObject):
            self._give_back(slot, row, bodies.pop(row, None))
            return row
        if isinstance(action, MoveObject):
            moved = bodies[row] = self._moved_to(slot, row, action)
        else:
            moved = bodies[row] = self._taken_away(slot, row, bodies.get(row))
        self._put(slot, row, moved)
        self._player.jump(slot, int(self._bodies.entity[slot, row]))
        return row

    def step(self, active: Sequence[int]) -> None:
        """A step of these slots is over: what was moved in them goes on."""
        if not self._moved:
            return
        for slot in active:
            for row, moved in self._moved.get(slot, {}).items():
                moved.steps += 1
                if moved.speed_mps and not moved.away:
                    self._put(slot, row, moved)

    def _moved_to(self, slot: int, row: int, action: MoveObject) -> _Moved:
        """The place of an entity whose box has its middle where the action says."""
        ahead, aside = self._bodies.centre_m[slot, row].tolist()
        c, s = float(cosine(action.yaw_rad)), float(sine(action.yaw_rad))
        x_m, y_m = action.x_m - (ahead * c - aside * s), action.y_m - (ahead * s + aside * c)
        return _Moved(x_m, y_m, action.z_m, action.yaw_rad, action.speed_mps)

    def _taken_away(self, slot: int, row: int, before: _Moved | None) -> _Moved:
        if before is not None and before.away:
            return before
        reals = self._player.bodies.reals.numpy()[slot, self._bodies.entity[slot, row]]
        x_m, y_m, z_m = (float(reals[name]) for name in (Real.X, Real.Y, Real.Z))
        return _Moved(
            x_m, y_m, z_m, float(reals[Real.HEADING]), float(reals[Real.SPEED]), away=True
        )

    def _give_back(self, slot: int, row: int, moved: _Moved | None) -> None:
        if moved is None:
            return
        entity = int(self._bodies.entity[slot, row])
        if moved.away:
            moved.away, moved.steps = False, 0
            self._put(slot, row, moved)
            self._player.jump(slot, entity)
        self._player.release(slot, entity)

    def _put(self, slot: int, row: int, moved: _Moved) -> None:
        """Tell the player where a body is now."""
        entity = int(self._bodies.entity[slot, row])
        if moved.away:
            self._player.impose(slot, entity, AWAY_M, AWAY_M, 0.0, 0.0, 0.0, 0.0, 0.0)
            return
        way_m = moved.speed_mps * self._step_s * moved.steps
        x_m = moved.x_m + way_m * float(cosine(moved.heading_rad))
        y_m = moved.y_m + way_m * float(sine(moved.heading_rad))
        heading, speed = moved.heading_rad, moved.speed_mps
        before = moved.z_m, moved.pitch_rad, moved.roll_rad
        self._player.impose(slot, entity, x_m, y_m, before[0], heading, *before[1:], speed)
        road = int(self._player.bodies.wholes.numpy()[slot, entity, Whole.ROAD])
        if road < 0:
            return
        reals = self._player.bodies.reals.numpy()[slot, entity]
        now = self._on_road(road, float(reals[Real.S]), float(reals[Real.T]), heading)
        if now != before:
            moved.z_m, moved.pitch_rad, moved.roll_rad = now
            self._player.impose(slot, entity, x_m, y_m, now[0], heading, *now[1:], speed)

    def _on_road(
        self, road: int, s_m: float, t_m: float, heading_rad: float
    ) -> tuple[float, float, float]:
        """Height [m] of a place of a road, and pitch and roll [rad] of what stands on it so."""
        frame = self._frames[road]
        pose = frame.pose(float(np.clip(s_m, 0.0, frame.road.length_m)), t_m)
        angles = [float(pose.heading_rad), float(pose.pitch_rad), float(pose.roll_rad)]
        if not any(angles[1:]):
            return float(pose.z_m), 0.0, 0.0
        up_x, up_y, up_z = body_axes(*angles)[2].tolist()
        c, s = float(cosine(heading_rad)), float(sine(heading_rad))
        # The forward axis (c, s, climb) and the left one lie in the surface.
        climb = -(up_x * c + up_y * s) / up_z
        left_z = (up_x * s - up_y * c) / math.sqrt(1.0 + climb * climb)
        pitch, roll = settled(np.array([-math.atan(climb), math.atan2(left_z, up_z)])).tolist()
        return float(pose.z_m), pitch, roll
