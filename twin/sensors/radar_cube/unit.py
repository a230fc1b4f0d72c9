"""The cubes of a rig as a ray sensor, made of what its radar has just measured."""

from __future__ import annotations

import numpy as np

from schemas.case import Case
from twin.sensors.data import SensorData
from twin.sensors.radar.unit import RadarUnit
from twin.sensors.radar_cube.cube import RadarCubes
from twin.sensors.ray_sensor import Moment, RayMount, Sight
from twin.world.sky.sun import Daylight
from twin.world.sky.weather import WeatherParameters


class RadarCubeUnit:
    """The sensor ``radar_cube``: made of what the sensor ``radar`` has just measured."""

    needs_truth = False

    def __init__(self, mount: RayMount, hz: int, radar: RadarUnit) -> None:
        self.every = mount.case.rig.control_hz // hz
        self._radar = radar
        geometry = mount.geometry
        self._cube = RadarCubes(geometry.slots, geometry.device, mount.buffers.get("radar_cube"))

    def reset(self, slot: int, case: Case) -> None:
        """The radar begins the case."""

    def light(
        self,
        slot: int,
        light: Daylight,
        weather: WeatherParameters,
        wind_towards: tuple[float, float],
    ) -> None:
        """The radar has the air."""

    def clear(self, slot: int) -> None:
        """The radar is cleared."""

    def hold(self, slot: int, *, held: bool) -> None:
        """The radar is held."""

    def save(self, slot: int) -> dict[str, np.ndarray]:  # noqa: ARG002 - of no slot anything
        """Nothing is remembered."""
        return {}

    def restore(self, slot: int, saved: dict[str, np.ndarray]) -> None:
        """Nothing is remembered."""

    def moved(self, slot: int) -> None:
        """A cube depends on nothing before it."""

    def advance(self, now: Moment) -> None:
        """A cube depends on nothing between it and the last."""

    def launch(self, sight: Sight) -> None:  # noqa: ARG002 - the radar has looked
        """Make the cubes of the radar's measurement, which it has begun at this tick."""
        self._cube.clear()
        for sensor in self._radar.sensors():
            self._cube.take(sensor)

    def read(self) -> dict[str, SensorData]:
        """Cubes."""
        return {"radar_cube": SensorData.mirrored(self._cube.cube)}
