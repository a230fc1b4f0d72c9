"""The driving robots of all slots: they hold the scenario's path and speed until a stack acts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import warp as wp

from twin.scenario.case_motion import CaseMotion
from twin.vehicle import carry_kernel
from twin.vehicle.carry import Carrier
from twin.vehicle.fleet import Fleet
from twin.vehicle.powertrain import COMMANDS
from twin.vehicle.state import COLUMN, columns

STEERING_MPS = 1.0
"""Slower than this, steering is no intervention: the path of a car that hardly moves has no angle
[m/s]."""
_BRAKE, _HANDBRAKE = COMMANDS.index("brake"), COMMANDS.index("handbrake")
_STEERING, _THROTTLE = COMMANDS.index("steering_rad"), COMMANDS.index("throttle")


class DrivingRobots:
    """Moves scenario and vehicles together: vehicles that a robot drives go where the scenario has
    the ego, all others as their commands say."""

    def __init__(self, motion: CaseMotion, fleet: Fleet, device: wp.Device) -> None:
        """``motion`` moves the bodies of the slots of ``fleet``."""
        self._motion = motion
        self._fleet = fleet
        self._device = device
        self._carrier = Carrier(fleet, motion.steps)
        self._turns = np.zeros(fleet.slots, np.bool_)
        """The vehicle of a slot has come along its path, so its turning rate is that of it."""

    @classmethod
    def of(cls, motion: CaseMotion | None, fleet: Fleet, device: wp.Device) -> DrivingRobots | None:
        """Robots of a rig; None: its scenarios move nothing."""
        return None if motion is None else cls(motion, fleet, device)

    def begin(self, slot: int) -> None:
        """A case begins in a slot, whose vehicle has been placed level: if a robot drives it, it
        stands on the road as the scenario has it. Derived columns are to be refreshed after."""
        if self._motion.robot(slot) is None:
            return
        wp.load_module(carry_kernel, device=self._device)  # not in the middle of a case
        led = self._motion.led_pose(slot)
        row = self._fleet.state[slot, 0]
        row[columns("com")], row[columns("orientation")] = self._carrier.body(slot, led.pose)
        self._fleet.roll(slot, led.speed_mps, 0.0)
        self._turns[slot] = False

    def save(self, slot: int) -> dict[str, Any]:
        """Whether a slot's vehicle has come along its path; the rest is the scenario's."""
        return {"turns": bool(self._turns[slot])}

    def restore(self, slot: int, saved: dict[str, Any]) -> None:
        """Go on with that."""
        self._turns[slot] = saved["turns"]

    def refuse(self, slot: int) -> None:
        """Let nobody else put the ego of a slot elsewhere.

        Raises:
            ValueError: a robot drives it; one line.
        """
        if self._motion.robot(slot) is not None:
            raise ValueError("the robot has the ego of this case until the stack intervenes")

    def watch(self, slots: Iterable[int]) -> None:
        """Look at the commands that come into force in this period; a robot lets go where they are
        an intervention: from here on the vehicle's own model drives, from this pose and speed.

        What has not arrived or got lost on the way is no intervention. Of older commands that are
        in force until then, the throttle is taken back: the robot had the pedals.
        """
        released = False
        for slot in slots:
            limits = self._motion.robot(slot)
            if limits is None:
                continue
            command = self._fleet.commands[slot, 0, 1]
            path_rad = self._path_rad(slot)
            brake, handbrake, steering_rad = command[[_BRAKE, _HANDBRAKE, _STEERING]].tolist()
            kind = limits.exceeded(brake, handbrake, steering_rad, path_rad)
            if kind:
                speed_mps = self._motion.led_pose(slot).speed_mps
                self._fleet.roll(slot, speed_mps, path_rad or 0.0)
                self._fleet.commands[slot, 0, 0, _THROTTLE] = 0.0
                self._motion.intervene(slot, kind)
                released = True
        if released:
            self._fleet.refresh()

    def advance(
        self,
        active: np.ndarray,
        steps: int,
        hulls: Callable[[], np.ndarray],
        weather: Callable[[int], None],
    ) -> list[int]:
        """One control period of scenario and vehicles, in steps of the scenario.

        Both go on from the same states: in a step of the scenario, the vehicle meets the bodies as
        they move at its beginning, and the scenario sees the vehicle as it is then.

        Args:
            active: slots that go on, bool [S].
            steps: physics steps of the period.
            hulls: gives those of the bodies now [S, M, 8].
            weather: told each slot whose scenario has changed weather, light or road.

        Returns:
            Slots whose vehicle was put elsewhere.
        """
        fleet, scenario_steps = self._fleet, self._motion.steps
        elsewhere = list[int]()
        for done in range(0, steps, scenario_steps):
            if done:
                fleet.movers[...] = hulls()
                fleet.switch_step[...] -= scenario_steps
                fleet.first_step[...] += scenario_steps
            elsewhere += self._step(active, weather)
        return elsewhere

    def _step(self, active: np.ndarray, weather: Callable[[int], None]) -> list[int]:
        """One step of the scenario; slots whose vehicle was put elsewhere."""
        motion, fleet = self._motion, self._fleet
        motion.step(fleet.state[:, 0], active)
        for slot in dict.fromkeys(motion.weathered()):
            weather(slot)
        led = [slot for slot in np.flatnonzero(active).tolist() if motion.robot(slot) is not None]
        fleet.active[led] = 0
        fleet.advance(motion.steps)
        fleet.active[led] = 1
        if not led:
            return []
        elsewhere: list[int] = self._carrier.carry(
            {slot: motion.led_pose(slot).pose for slot in led}
        )
        for slot in elsewhere:  # who is put somewhere else does not come to rest there
            fleet.roll(slot, motion.led_pose(slot).speed_mps, 0.0)
        self._turns[led] = True
        self._turns[elsewhere] = False
        if elsewhere:
            fleet.refresh()
        return elsewhere

    def _path_rad(self, slot: int) -> float | None:
        """Road-wheel angle that a car without slip takes on the path of a slot's robot, the
        bicycle's atan(wheelbase x curvature) [rad]; None: it hardly moves, or was put there."""
        row = self._fleet.state[slot, 0]
        speed_mps = float(row[COLUMN["speed_mps"]])
        if abs(speed_mps) < STEERING_MPS or not self._turns[slot]:
            return None
        curvature_per_m = float(row[COLUMN["yaw_rate_radps"]]) / speed_mps
        return math.atan(self._fleet.vehicles[0].wheelbase_m * curvature_per_m)
