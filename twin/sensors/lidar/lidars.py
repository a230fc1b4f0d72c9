"""The LiDARs of a rig: where they sit, their arrays, and each as a ray sensor."""

from __future__ import annotations

import numpy as np

from schemas.case import Case
from schemas.identity import case_stream
from schemas.messages import LidarSite
from schemas.sections.lidar import lidar_columns
from twin.fabric.frames import FrameChannel
from twin.render.memory import LidarLoad, MemoryRow
from twin.sensors.data import SensorData
from twin.sensors.lidar.lidar import LidarSensor, LidarWeather
from twin.sensors.lidar.profile_file import mounted_profile
from twin.sensors.mount import KeyOf
from twin.sensors.ray_sensor import Moment, RayMount, Sight
from twin.vehicle.vehicle_file import Vehicle
from twin.world.sky.sun import Daylight
from twin.world.sky.weather import WeatherParameters
from twin.world.street.build import World


def lidar_sites(case: Case, vehicle: Vehicle) -> list[LidarSite]:
    """What a stack may know of the lidars.

    Raises:
        ValueError: the vehicle has no such lidar, or its rate does not fit; one line.
    """
    sites = []
    for lidar in case.rig.lidars:
        mount = vehicle.lidar(lidar.name)
        profile = mounted_profile(mount)
        hz = lidar.hz or profile.hz
        if case.rig.control_hz % hz:
            raise ValueError(
                f"lidar '{lidar.name}': its profile's {hz} Hz do not divide control_hz "
                f"{case.rig.control_hz}; give lidars[].hz"
            )
        sites.append(
            LidarSite(
                name=lidar.name,
                message=f"lidar.{lidar.name}",
                hz=hz,
                channels=profile.channels,
                columns=profile.columns,
                fields=list(lidar_columns(lidar)),
                position_m=mount.position_m,
                rotation_deg=mount.rotation_deg,
            )
        )
    return sites


class Lidars:
    """LiDARs as :class:`twin.sensors.ray_sensor.RayRig`."""

    def channels(self, case: Case, vehicle: Vehicle, slots: int) -> list[FrameChannel]:
        """Points [S, N, K] of each.

        Raises:
            ValueError: the vehicle has no such lidar, or its rate does not fit; one line.
        """
        return [
            FrameChannel(
                site.message, (slots, site.channels * site.columns, len(site.fields)), "<f4"
            )
            for site in lidar_sites(case, vehicle)
        ]

    def memory(
        self,
        case: Case,
        vehicle: Vehicle,
        world: World,  # noqa: ARG002 - rays are as many in any world
    ) -> list[MemoryRow]:
        """A point of the cloud per ray, and what the ray met on the way there.

        Raises:
            ValueError: the vehicle has no such lidar; one line.
        """
        rows = []
        for lidar in case.rig.lidars:
            profile = mounted_profile(vehicle.lidar(lidar.name))
            bytes_per_ray = 4 * len(lidar_columns(lidar)) + 16 * profile.sub_rays + 16
            rays = profile.channels * profile.columns
            rows.append(LidarLoad(f"lidar.{lidar.name}", rays, bytes_per_ray).row)
        return rows

    def build(self, mount: RayMount) -> list[MountedLidar]:
        """Allocate and compile.

        Raises:
            ValueError: the vehicle has no such lidar, or its rate does not fit; one line.
        """
        sites = lidar_sites(mount.case, mount.vehicle)
        return [MountedLidar(mount, index, site) for index, site in enumerate(sites)]


class MountedLidar:
    """One lidar, in all slots."""

    needs_truth = True

    def __init__(self, mount: RayMount, index: int, site: LidarSite) -> None:
        """``index``: of the lidar in the rig."""
        on_vehicle = mount.vehicle.lidar(site.name)
        self.every = mount.case.rig.control_hz // site.hz
        self._site = site
        self.messages = frozenset([site.message])
        self._stream = f"lidar/{site.name}"
        self._sensor = LidarSensor(
            mounted_profile(on_vehicle),
            on_vehicle,
            mount.geometry,
            mount.case.rig.lidars[index],
            mount.buffers.get(site.message),
        )

    def reset(self, slot: int, case: Case) -> None:
        """Begin a case."""
        self._sensor.reset(slot, case_stream(case, self._stream))

    def redraw(self, slot: int, key: KeyOf) -> None:
        """Draw by another key."""
        self._sensor.air.host[slot]["key"] = key(self._stream)

    def light(
        self,
        slot: int,
        light: Daylight,  # noqa: ARG002 - it has a light of its own
        weather: WeatherParameters,
        wind_towards: tuple[float, float],  # noqa: ARG002 - drops fall as they fall
    ) -> None:
        """Air of a slot from now on."""
        air = LidarWeather(
            extinction_per_m=weather.extinction_per_m,
            rain_mm_per_h=weather.rain_mm_per_h,
            snow_mm_per_h=weather.snow_mm_per_h,
            wetness=weather.wetness,
            snow_cover=weather.snow_cover,
        )
        self._sensor.weather(slot, air)

    def clear(self, slot: int) -> None:
        """Make a slot inactive."""
        self._sensor.clear(slot)

    def hold(self, slot: int, *, held: bool) -> None:
        """Leave a slot out of sweeps, or take it in again as it was."""
        self._sensor.air.host[slot]["active"] = int(not held)

    def save(self, slot: int) -> dict[str, np.ndarray]:
        """Key, and where the sweep before began."""
        return self._sensor.save(slot)

    def restore(self, slot: int, saved: dict[str, np.ndarray]) -> None:
        """Go on with them."""
        self._sensor.restore(slot, saved)

    def moved(self, slot: int) -> None:
        """The ego was put elsewhere."""
        self._sensor.air.host[slot]["fresh"] = 1

    def advance(self, now: Moment) -> None:
        """A sweep depends on nothing between it and the last."""

    def launch(self, sight: Sight) -> None:
        """Begin a sweep."""
        assert sight.truth is not None
        self._sensor.air.host["tick"] = sight.now.tick
        self._sensor.scan(sight.truth)

    def read(self) -> dict[str, SensorData]:
        """Points of the sweep."""
        count = self._sensor.count.numpy()
        return {self._site.message: SensorData.mirrored(self._sensor.mirror, count)}


LIDARS = Lidars()
