"""What looks at the world: ray sensors of a rig, each at its own rate, one geometry."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from schemas.case import Case
from schemas.messages import Lights
from twin.actors.motion import Placement
from twin.fabric.frames import FrameChannel
from twin.render.memory import check_free, free_bytes
from twin.render.trace.geometry import Geometry
from twin.sensors.data import SensorData
from twin.sensors.mount import KeepsReading, KeyOf, Redraws
from twin.sensors.ray_kinds import ray_rigs
from twin.sensors.ray_sensor import Moment, MountedRay, RayMount, Sight
from twin.sensors.rig_memory import rig_memory
from twin.sensors.wanted import Wanted
from twin.vehicle.vehicle_file import Vehicle, load_vehicle
from twin.world.scene import Scene
from twin.world.sky.sun import Daylight
from twin.world.sky.weather import WeatherParameters
from twin.world.street.build import World


def frame_channels(case: Case, slots: int) -> list[FrameChannel]:
    """The arrays of a rig that are large enough to be worth sharing: those of its ray sensors.

    Raises:
        ValueError: the vehicle has no such sensor; one line.
    """
    vehicle = load_vehicle(case.rig.vehicle)
    return [channel for rig in ray_rigs() for channel in rig.channels(case, vehicle, slots)]


class ExteroceptiveSuite:
    """Ray sensors of all slots."""

    def __init__(
        self,
        case: Case,
        vehicle: Vehicle,
        scene: Scene,
        world: World,
        slots: int,
        device: wp.Device,
        buffers: Mapping[str, np.ndarray],
    ) -> None:
        """``buffers``: host arrays by channel name; missing ones are allocated.

        Raises:
            ValueError: the vehicle has no such sensor, or the GPU has too little memory; one line.
        """
        _check_memory(case, vehicle, world, slots, device)
        self._geometry = Geometry(world, slots, device)
        mount = RayMount(case, vehicle, scene, world, self._geometry, buffers)
        self._sensors = [sensor for rig in ray_rigs() for sensor in rig.build(mount)]
        self.needs_truth = any(sensor.needs_truth for sensor in self._sensors)
        """:meth:`read` needs the vehicles' truth."""
        self.period = math.lcm(*(sensor.every for sensor in self._sensors))
        """Control periods after which all are due together again."""
        self._left_out: set[MountedRay] = set()
        """Sensors whose last reading nobody wanted."""

    def reset(self, slot: int, case: Case) -> None:
        """Begin a case; :meth:`light` must follow."""
        for sensor in self._sensors:
            sensor.reset(slot, case)

    def light(
        self,
        slot: int,
        light: Daylight,
        weather: WeatherParameters,
        wind_towards: tuple[float, float],
    ) -> None:
        """Light and air of a slot from now on; ``wind_towards``: unit vector along the wind."""
        for sensor in self._sensors:
            sensor.light(slot, light, weather, wind_towards)

    def clear(self, slot: int) -> None:
        """Make a slot inactive."""
        for sensor in self._sensors:
            sensor.clear(slot)

    def hold(self, slot: int, *, held: bool) -> None:
        """Leave a slot out of the readings, or take it in again as it was."""
        for sensor in self._sensors:
            sensor.hold(slot, held=held)

    def redraw(self, slot: int, key: KeyOf) -> None:
        """Draw a slot's noise by other keys from the next reading on."""
        for sensor in self._sensors:
            if isinstance(sensor, Redraws):
                sensor.redraw(slot, key)

    def save(self, slot: int) -> dict[str, Any]:
        """What the sensors remember of a slot, by their order.

        Raises:
            ValueError: one of them cannot be saved; one line.
        """
        saved = {}
        for number, sensor in enumerate(self._sensors):
            if not isinstance(sensor, KeepsReading):
                raise ValueError(f"a ray sensor of {type(sensor).__name__} cannot be saved")
            saved[f"{number}"] = sensor.save(slot)
        return saved

    def restore(self, slot: int, saved: dict[str, Any]) -> None:
        """Go on with what was saved, in a slot whose case has just begun."""
        for number, its in saved.items():
            sensor = self._sensors[int(number)]
            assert isinstance(sensor, KeepsReading)
            sensor.restore(slot, its)

    def moved(self, slot: int) -> None:
        """The ego was put elsewhere: nothing leads from the last readings to the next."""
        for sensor in self._sensors:
            sensor.moved(slot)

    def read(
        self,
        now: Moment,
        lights: list[Lights | None],
        placement: Placement,
        pose: wp.array,
        truth: wp.array | None,
        wanted: Wanted = None,
    ) -> dict[str, SensorData]:
        """Readings that are due and wanted; to be called at every tick, before the step.

        What is wanted has the same bytes whatever else is.

        Args:
            now: ticks and times of the slots.
            lights: lamps of each slot's ego; None where inactive.
            placement: where the objects are.
            pose: vehicle states on the device [S, T].
            truth: rows of :class:`twin.sensors.vehicle_truth.VehicleTruth`, where
                :attr:`needs_truth`.
            wanted: messages that somebody looks at.
        """
        if not now.active.any():
            return {}
        for sensor in self._sensors:
            sensor.advance(now)
        phase = now.tick[now.active] % self.period
        assert (phase == phase[0]).all(), "active slots are not due for their frames together"
        due = [sensor for sensor in self._sensors if phase[0] % sensor.every == 0]
        due = [sensor for sensor in due if self._is_wanted(sensor, wanted, now)]
        if not due:
            return {}
        self._geometry.place(placement)
        # All that is to be computed first: the first result that is asked for waits for the GPU.
        sight = Sight(now, lights, pose, truth)
        for sensor in due:
            sensor.launch(sight)
        readings: dict[str, SensorData] = {}
        for sensor in due:
            readings.update(sensor.read())
        return readings

    def _is_wanted(self, sensor: MountedRay, wanted: Wanted, now: Moment) -> bool:
        """Whether a sensor that is due is to be read. One that was left out meanwhile begins anew:
        nothing leads from its last reading to this one."""
        if wanted is not None and wanted.isdisjoint(sensor.messages):
            self._left_out.add(sensor)
            return False
        if sensor in self._left_out:
            self._left_out.discard(sensor)
            for slot in np.flatnonzero(now.active).tolist():
                sensor.moved(slot)
        return True


def _check_memory(
    case: Case, vehicle: Vehicle, world: World, slots: int, device: wp.Device
) -> None:
    """Say what is about to be taken on a GPU; refuse what does not fit."""
    found = rig_memory(case, vehicle, world, slots)
    if device.is_cuda:
        print(
            f"cameras and lidars of {slots} slots take {found.bytes_total / 1e9:.2f} GB of GPU "
            f"memory, {free_bytes(device) / 1e9:.2f} GB are free",
            file=sys.stderr,
            flush=True,
        )
    check_free(found, device)
