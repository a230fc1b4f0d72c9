"""Ray sensors of the table of kinds: rows of numbers, as many as a slot has, or a grid."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from schemas.case import Case
from schemas.kinds.registry import implementation
from schemas.kinds.sensor import SensorKind, sensor_kinds
from twin.fabric.frames import FrameChannel
from twin.render.memory import MemoryRow
from twin.sensors.data import SensorData
from twin.sensors.mount import KeepsReading, KeyOf, Redraws
from twin.sensors.ray_sensor import Moment, RayMount, RaySensor, Sight
from twin.vehicle.vehicle_file import Vehicle
from twin.world.sky.sun import Daylight
from twin.world.sky.weather import WeatherParameters
from twin.world.street.build import World


class DeclaredRays:
    """Sensors whose declaration says that they look at the world, as a
    :class:`twin.sensors.ray_sensor.RayRig`."""

    def channels(
        self,
        case: Case,
        vehicle: Vehicle,  # noqa: ARG002 - the declaration says all
        slots: int,
    ) -> list[FrameChannel]:
        """Rows [S, N, K] or grid of each."""
        return [_channel(kind, slots) for kind, _ in _asked(case)]

    def memory(
        self,
        case: Case,
        vehicle: Vehicle,  # noqa: ARG002 - the declaration says all
        world: World,
    ) -> list[MemoryRow]:
        """Values of each, and what an implementation takes besides."""
        rows = []
        for kind, _ in _asked(case):
            values = "grid" if kind.grid else "rows"
            rows.append(MemoryRow(f"{kind.name}: {values}", 0, _channel(kind, 1).size))
            if kind.memory:
                more = implementation(kind.memory)(case, world)
                rows.append(MemoryRow(f"{kind.name}: its work", 0, more))
        return rows

    def build(self, mount: RayMount) -> list[DeclaredRay]:
        """Make what the declarations name.

        Raises:
            ValueError: an implementation cannot be imported; one line.
        """
        built: dict[str, RaySensor] = {}
        sensors: list[DeclaredRay] = []
        for kind, hz in _asked(mount.case):
            whole = (built[kind.part_of],) if kind.part_of else ()
            built[kind.name] = implementation(kind.implementation)(mount, hz, *whole)
            sensors.append(DeclaredRay(kind, mount, hz, built[kind.name]))
        # What a sensor is made of is read with it.
        for sensor in reversed(sensors):
            for whole in sensors:
                if whole.kind.name == sensor.kind.part_of:
                    whole.messages |= sensor.messages
        return sensors


class DeclaredRay:
    """One sensor; what it reads is held against its declaration and put where stacks look."""

    def __init__(self, kind: SensorKind, mount: RayMount, hz: int, sensor: RaySensor) -> None:
        """``hz``: readings per second [Hz]; ``sensor``: what the declaration names."""
        self._sensor = sensor
        self.kind = kind
        self.messages = frozenset([kind.name])
        self.every = mount.case.rig.control_hz // hz
        self.needs_truth = self._sensor.needs_truth
        self._channel = _channel(kind, mount.geometry.slots)
        self._shared = mount.buffers.get(kind.name)

    def reset(self, slot: int, case: Case) -> None:
        """See :class:`twin.sensors.ray_sensor.RaySensor`, as of all others."""
        self._sensor.reset(slot, case)

    def redraw(self, slot: int, key: KeyOf) -> None:
        """Draw by other keys, if it draws."""
        if isinstance(self._sensor, Redraws):
            self._sensor.redraw(slot, key)

    def light(
        self,
        slot: int,
        light: Daylight,
        weather: WeatherParameters,
        wind_towards: tuple[float, float],
    ) -> None:
        """Light and air of a slot from now on."""
        self._sensor.light(slot, light, weather, wind_towards)

    def clear(self, slot: int) -> None:
        """Make a slot inactive."""
        self._sensor.clear(slot)

    def hold(self, slot: int, *, held: bool) -> None:
        """Leave a slot out of the readings, or take it in again as it was."""
        self._sensor.hold(slot, held=held)

    def save(self, slot: int) -> dict[str, np.ndarray]:
        """What it remembers of a slot.

        Raises:
            ValueError: it cannot be saved; one line.
        """
        if not isinstance(self._sensor, KeepsReading):
            raise ValueError(f"sensor '{self._channel.name}' cannot be saved")
        return self._sensor.save(slot)

    def restore(self, slot: int, saved: dict[str, np.ndarray]) -> None:
        """Go on with that."""
        assert isinstance(self._sensor, KeepsReading)
        self._sensor.restore(slot, saved)

    def moved(self, slot: int) -> None:
        """The ego was put elsewhere."""
        self._sensor.moved(slot)

    def advance(self, now: Moment) -> None:
        """Take note of the time."""
        self._sensor.advance(now)

    def launch(self, sight: Sight) -> None:
        """Begin a reading."""
        self._sensor.launch(sight)

    def read(self) -> dict[str, SensorData]:
        """Rows, and how many of them are valid; or a grid.

        Raises:
            ValueError: they are not what the declaration says; one line.
        """
        readings = self._sensor.read()
        name, shape = self._channel.name, self._channel.shape
        if set(readings) != {name}:
            raise ValueError(f"sensor '{name}' reads {sorted(readings)}; declared: '{name}' alone")
        data = readings[name]
        if data.shape != shape:
            raise ValueError(f"sensor '{name}' reads {data.shape}; declared: {shape}")
        if self.kind.grid:
            return {name: self._shown(data, None)}
        count = np.zeros(0, np.int32) if data.count is None else np.asarray(data.count)
        if count.shape != shape[:1] or count.min() < 0 or count.max() > shape[1]:
            raise ValueError(
                f"sensor '{name}' counts {count.tolist()} valid rows; "
                f"allowed: 0 to {shape[1]} in each of {shape[0]} slots"
            )
        return {name: self._shown(data, count)}

    def _shown(self, data: SensorData, count: np.ndarray | None) -> SensorData:
        """``data`` where stacks look for it, on a GPU until the host asks."""
        if data.device is None:
            return SensorData(self._hosted(data), count)
        return SensorData(lambda: self._hosted(data), count, data.device)

    def _hosted(self, data: SensorData) -> np.ndarray:
        """Values on the host, in memory shared with the stack where there is some."""
        values = data.values
        if values.dtype != np.dtype(self._channel.dtype):
            raise ValueError(
                f"sensor '{self._channel.name}' reads {values.dtype}; "
                f"declared: {np.dtype(self._channel.dtype)}"
            )
        if self._shared is None:
            return values
        if values is not self._shared:
            np.copyto(self._shared, values)
        return self._shared


def _asked(case: Case) -> Iterator[tuple[SensorKind, int]]:
    """The sensors that a rig has, and their rates [Hz]."""
    for name, hz in case.rig.sensor_hz.items():
        kind = sensor_kinds().find(name)
        if kind.looks:
            yield kind, hz


def _channel(kind: SensorKind, slots: int) -> FrameChannel:
    return FrameChannel(kind.name, (slots, *kind.shape), kind.dtype)


DECLARED = DeclaredRays()
