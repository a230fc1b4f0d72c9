"""Co-simulation: the stack's own model moves the car, and poses say where it is."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from schemas.messages import Pose
from twin.vehicle.carry_kernel import GOES, JUMPS
from twin.vehicle.fleet import Fleet
from twin.vehicle.model import PHYSICS_STEP_NS
from twin.vehicle.state import columns

SPEED_MAX_MPS = 150.0
"""Poses further apart are no way that a car drives [m/s]."""


class Carrier:
    """Carries the first vehicle of slots where poses say."""

    def __init__(self, fleet: Fleet, steps: int) -> None:
        """``steps``: physics steps of a control period."""
        self._fleet = fleet
        self._steps = steps
        self._reach_m = SPEED_MAX_MPS * steps * PHYSICS_STEP_NS / 1e9
        """Furthest way in one control period [m]."""

    def prepare(self) -> None:
        """Load the kernel before the first pose comes: that may take seconds."""
        still = np.zeros(self._fleet.slots, np.int32)
        nowhere = np.zeros((self._fleet.slots, 4))
        self._fleet.carry(0, still, nowhere[:, :3].copy(), nowhere)

    def mistake(self, slot: int, pose: Pose | None, *, allowed: bool, first: bool) -> str:
        """What is wrong with a command's pose, or an empty string; ``first``: of its case."""
        if pose is None:
            return ""
        if not allowed:
            return "command pose is given, but autonomy.cosim is off"
        way_m = self._way_m(slot, self.body(slot, pose)[0])
        if way_m > self._reach_m and not first:
            return (
                f"command pose is {way_m:.1f} m from the last one, allowed: {self._reach_m:g} m "
                f"in a control period ({SPEED_MAX_MPS:g} m/s)"
            )
        return ""

    def carry(self, poses: Mapping[int, Pose]) -> list[int]:
        """Move the vehicles of the slots in ``poses``; those that were put elsewhere, because no
        car drives so far in one period."""
        fleet = self._fleet
        carried = np.zeros(fleet.slots, np.int32)
        com, turn = np.zeros((fleet.slots, 3)), np.zeros((fleet.slots, 4))
        for slot, pose in poses.items():
            place, turn[slot] = self.body(slot, pose)
            com[slot] = place
            carried[slot] = JUMPS if self._way_m(slot, place) > self._reach_m else GOES
        fleet.carry(self._steps, carried, com, turn)
        return np.flatnonzero(carried == JUMPS).tolist()

    def _way_m(self, slot: int, com: np.ndarray) -> float:
        way = com - self._fleet.state[slot, 0, columns("com")]
        return math.sqrt(way.dot(way))

    def body(self, slot: int, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
        """Centre of mass [3] and orientation [4] of a slot's vehicle that is at a pose."""
        turn = np.array([pose.qx, pose.qy, pose.qz, pose.qw])
        turn /= math.sqrt(turn.dot(turn))
        return self._fleet.body_at(slot, pose.x_m, pose.y_m, pose.z_m, turn), turn
