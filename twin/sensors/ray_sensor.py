"""What looks at the world: the protocol of cameras, lidars and ray sensors of others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import warp as wp

from schemas.case import Case
from schemas.messages import Lights
from twin.fabric.frames import FrameChannel
from twin.render.memory import MemoryRow
from twin.render.trace.geometry import Geometry
from twin.sensors.data import SensorData
from twin.vehicle.vehicle_file import Vehicle
from twin.world.scene import Scene
from twin.world.sky.sun import Daylight
from twin.world.sky.weather import WeatherParameters
from twin.world.street.build import World


@dataclass(frozen=True, slots=True)
class Moment:
    """Where the slots' cases stand."""

    tick: np.ndarray
    """int32 [S]"""
    sim_time_ns: np.ndarray
    """int64 [S]"""
    active: np.ndarray
    """bool [S]"""


@dataclass(frozen=True, slots=True)
class Sight:
    """What a reading is made of."""

    now: Moment
    lights: Sequence[Lights | None]
    """Lamps of each slot's ego; None where inactive."""
    pose: wp.array
    """Vehicle states on the device [S, T]."""
    truth: wp.array | None
    """Rows of :class:`twin.sensors.vehicle_truth.VehicleTruth` [S, T]; there if any sensor of the
    rig needs them."""


@dataclass(frozen=True, slots=True)
class RayMount:
    """Rig that a sensor is built into."""

    case: Case
    """Any of the rig; nothing but its ``rig`` may be looked at."""
    vehicle: Vehicle
    scene: Scene
    world: World
    geometry: Geometry
    """What rays meet, shared by all sensors of the rig; the suite places the objects. It has the
    slots and the device."""
    buffers: Mapping[str, np.ndarray]
    """Host arrays that receive values, by channel name; missing ones are to be allocated."""


class RaySensor(Protocol):
    """One sensor of a rig that looks at the world, in all slots."""

    every: int
    """Control periods between two readings."""
    needs_truth: bool
    """It asks :attr:`Sight.truth`."""

    def reset(self, slot: int, case: Case) -> None:
        """Begin a case; :meth:`light` follows."""

    def light(
        self,
        slot: int,
        light: Daylight,
        weather: WeatherParameters,
        wind_towards: tuple[float, float],
    ) -> None:
        """Light and air of a slot from now on; ``wind_towards``: unit vector along the wind."""

    def clear(self, slot: int) -> None:
        """Make a slot inactive."""

    def hold(self, slot: int, *, held: bool) -> None:
        """Leave a slot out of the readings, or take it in again as it was."""

    def moved(self, slot: int) -> None:
        """The ego was put elsewhere: nothing leads from the last reading to the next."""

    def advance(self, now: Moment) -> None:
        """Take note of the time; at every tick, due or not."""

    def launch(self, sight: Sight) -> None:
        """Begin a reading. All that are due begin theirs before the first is asked for results,
        which may wait for the GPU."""

    def read(self) -> dict[str, SensorData]:
        """Values by message [S, ...], with valid rows per slot where they differ; zeros where
        inactive."""


class MountedRay(RaySensor, Protocol):
    """A ray sensor that its rig has mounted."""

    messages: frozenset[str]
    """Messages that need its readings: its own, and those of sensors that are made of them."""


class RayRig(Protocol):
    """The sensors of one kind in a rig: one object per kind, without a state of its own."""

    def channels(self, case: Case, vehicle: Vehicle, slots: int) -> list[FrameChannel]:
        """Arrays of the sensor's readings that are large enough to be worth sharing.

        Raises:
            ValueError: the vehicle has no such sensor; one line.
        """

    def memory(self, case: Case, vehicle: Vehicle, world: World) -> list[MemoryRow]:
        """What they take of a GPU.

        Raises:
            ValueError: the vehicle has no such sensor; one line.
        """

    def build(self, mount: RayMount) -> Sequence[MountedRay]:
        """Allocate and compile.

        Raises:
            ValueError: the vehicle has no such sensor, or it does not fit; one line.
        """
