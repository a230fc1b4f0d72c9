"""The car's own sensors that a campaign asks for, each at its own rate; none costs nothing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import warp as wp

from schemas.case import Case
from schemas.kinds.registry import implementation
from schemas.kinds.sensor import sensor_kinds
from schemas.messages import SensorErrors
from twin.sensors.mount import KeepsReading, KeyOf, Redraws, Sensor, SensorMount
from twin.world.scene import Origin


class SensorSuite:
    """Sensors of a rig. Which there are and their rates are the rig's, their errors the case's."""

    def __init__(self, case: Case, origin: Origin, slots: int, device: wp.Device) -> None:
        self._sensors: dict[str, Sensor] = {}
        for name, hz in case.rig.sensor_hz.items():
            kind = sensor_kinds().find(name)
            if kind.looks:
                continue  # it looks at the world: the exteroceptive suite has it
            build: type[Sensor] = implementation(kind.implementation)
            mount = SensorMount(slots, device, origin, hz, case.rig.control_hz // hz)
            self._sensors[name] = build(mount)
        self.needs_truth = bool(self._sensors)
        """:meth:`read` needs the vehicles' truth."""
        self.period = math.lcm(*(sensor.every for sensor in self._sensors.values()))
        """Control periods after which all sensors are due together again."""

    def reset(self, slot: int, case: Case) -> None:
        """Begin a case; the first reading is that of its tick 0."""
        for sensor in self._sensors.values():
            sensor.reset(slot, case)

    def clear(self, slot: int) -> None:
        """Make a slot inactive."""
        for sensor in self._sensors.values():
            sensor.clear(slot)

    def hold(self, slot: int, *, held: bool) -> None:
        """Leave a slot out of the readings, or take it in again as it was."""
        for sensor in self._sensors.values():
            sensor.hold(slot, held=held)

    def redraw(self, slot: int, key: KeyOf) -> None:
        """Draw a slot's errors by other keys from the next reading on."""
        for sensor in self._sensors.values():
            if isinstance(sensor, Redraws):
                sensor.redraw(slot, key)

    def save(self, slot: int) -> dict[str, Any]:
        """What the sensors remember of a slot.

        Raises:
            ValueError: one of them cannot be saved; one line.
        """
        saved = {}
        for name, sensor in self._sensors.items():
            if not isinstance(sensor, KeepsReading):
                raise ValueError(f"sensor '{name}' cannot be saved")
            saved[name] = sensor.save(slot)
        return saved

    def restore(self, slot: int, saved: dict[str, Any]) -> None:
        """Go on with what was saved, in a slot whose case has just begun."""
        for name, its in saved.items():
            sensor = self._sensors[name]
            assert isinstance(sensor, KeepsReading)
            sensor.restore(slot, its)

    def mistake(self, errors: SensorErrors | None) -> str:
        """What is wrong with changed errors, or an empty string."""
        if errors is None:
            return ""
        for field in errors.__struct_fields__:
            name = field.partition("_")[0]
            if name not in self._sensors and getattr(errors, field) != getattr(_AS_IS, field):
                return f"command sensors.{field} given, but the campaign has no sensors.{name}"
        return ""

    def modulate(self, slot: int, errors: SensorErrors) -> None:
        """Change the errors of a slot's sensors from the next tick on."""
        for sensor in self._sensors.values():
            sensor.modulate(slot, errors)

    def read(
        self, truth: wp.array | None, tick: np.ndarray, active: np.ndarray
    ) -> dict[str, np.ndarray]:
        """Readings of the sensors that are due; to be called at every tick, before the step.

        Args:
            truth: rows of :class:`twin.sensors.vehicle_truth.VehicleTruth`, if anything is there.
            tick: case ticks [S].
            active: bool [S].
        """
        if truth is None or not self._sensors or not active.any():
            return {}
        phase = tick[active] % self.period
        assert (phase == phase[0]).all(), "active slots are not due for their sensors together"
        return {
            name: sensor.read(truth, tick)
            for name, sensor in self._sensors.items()
            if phase[0] % sensor.every == 0
        }


_AS_IS = SensorErrors()
