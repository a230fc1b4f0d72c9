"""The radar of a rig as a ray sensor."""

from __future__ import annotations

import numpy as np

from schemas.case import Case
from schemas.identity import case_stream
from schemas.kinds.sensors.radar import COLUMNS, DETECTIONS_MAX, PROFILES
from twin.sensors.data import SensorData
from twin.sensors.mount import KeyOf
from twin.sensors.radar.profile import load_radar_profile
from twin.sensors.radar.sensor import RadarSensor, bodies_in, bytes_per_slot
from twin.sensors.ray_sensor import Moment, RayMount, Sight
from twin.vehicle.vehicle_file import Vehicle
from twin.world.sky.sun import Daylight
from twin.world.sky.weather import WeatherParameters
from twin.world.street.build import World


def site_of(
    case: Case, vehicle: Vehicle
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Where a case's radar sits: position in vehicle axes [m]; roll, pitch and yaw [deg]."""
    config = case.variation.sensors.radar
    profile = load_radar_profile(config.profile)
    yaw_deg = profile.yaw_deg if config.yaw_deg is None else config.yaw_deg
    front_m = vehicle.length_m - vehicle.rear_overhang_m
    left_m = 0.0 if profile.yaw_deg == 0.0 else 0.4 * vehicle.width_m
    x_m, y_m, z_m = config.position_m or (front_m, left_m, profile.height_m)
    return (x_m, y_m, z_m), (0.0, 0.0, yaw_deg)


def bytes_of(case: Case, world: World) -> int:
    """What a slot's radar takes of a GPU besides its detections [bytes]."""
    profile = load_radar_profile(case.variation.sensors.radar.profile)
    return bytes_per_slot(profile, bodies_in(world, world.motion.count))


class RadarUnit:
    """Radars of all slots, columns :data:`schemas.kinds.sensors.radar.COLUMNS`.

    The profile is a case's, so slots may have different ones; there is a sensor for each that any
    case has asked for.
    """

    needs_truth = False

    def __init__(self, mount: RayMount, hz: int) -> None:
        self.every = mount.case.rig.control_hz // hz
        self._mount = mount
        slots = mount.geometry.slots
        self._profile = [""] * slots
        self._weather = np.zeros(slots, np.bool_)
        self._active = np.zeros(slots, np.bool_)
        self._sensors: dict[str, RadarSensor] = {}
        # Compiled while the rig is built, which is no time of a case.
        self._sensor(mount.case.variation.sensors.radar.profile)

    def reset(self, slot: int, case: Case) -> None:
        """Begin a case."""
        config = case.variation.sensors.radar
        sensor = self._sensor(config.profile)
        self._profile[slot] = config.profile
        self._active[slot] = True
        self._weather[slot] = config.weather
        key = case_stream(case, "radar")
        sensor.reset(slot, key, noise=config.noise)
        row = sensor.state.host[slot]
        row["multipath"], row["clutter"] = int(config.multipath), int(config.clutter)
        position_m, (_, _, yaw_deg) = site_of(case, self._mount.vehicle)
        sensor.mount(slot, position_m, yaw_deg)

    def redraw(self, slot: int, key: KeyOf) -> None:
        """Draw by another key."""
        self._sensors[self._profile[slot]].state.host[slot]["key"] = key("radar")

    def _sensor(self, profile: str) -> RadarSensor:
        if profile not in self._sensors:
            buffer = None if self._sensors else self._mount.buffers.get("radar")
            self._sensors[profile] = RadarSensor(
                load_radar_profile(profile), self._mount.geometry, rows_out=buffer
            )
        return self._sensors[profile]

    def light(
        self,
        slot: int,
        light: Daylight,  # noqa: ARG002 - it has a light of its own
        weather: WeatherParameters,
        wind_towards: tuple[float, float],  # noqa: ARG002 - the spread of the drops has it
    ) -> None:
        """Air of a slot from now on."""
        if self._weather[slot]:
            sensor = self._sensors[self._profile[slot]]
            sensor.weather(slot, weather.rain_mm_per_h, weather.snow_mm_per_h, weather.wetness)

    def clear(self, slot: int) -> None:
        """Make a slot inactive."""
        self._active[slot] = False

    def hold(self, slot: int, *, held: bool) -> None:
        """Leave a slot out of the measurements, or take it in again as it was."""
        self._active[slot] = not held

    def save(self, slot: int) -> dict[str, np.ndarray]:
        """The key of the noise."""
        row = self._sensors[self._profile[slot]].state.host[slot]
        return {"key": np.array(row["key"])}

    def restore(self, slot: int, saved: dict[str, np.ndarray]) -> None:
        """Go on with it."""
        self._sensors[self._profile[slot]].state.host[slot]["key"] = saved["key"]

    def moved(self, slot: int) -> None:
        """A measurement depends on nothing before it."""

    def advance(self, now: Moment) -> None:
        """A measurement depends on nothing between it and the last."""

    def launch(self, sight: Sight) -> None:
        """Begin a measurement."""
        for name, sensor in self._sensors.items():
            its = np.array([profile == name for profile in self._profile])
            sensor.state.host["tick"] = sight.now.tick
            sensor.state.host["active"] = self._active & its
            sensor.measure(sight.pose)

    def sensors(self) -> list[RadarSensor]:
        """Radars of the profiles that any case has asked for; a slot is active in one of them."""
        return [self._sensors[name] for name in PROFILES if name in self._sensors]

    def read(self) -> dict[str, SensorData]:
        """Detections."""
        sensors = self.sensors()
        if len(sensors) == 1:
            return {"radar": SensorData.mirrored(sensors[0].rows, sensors[0].count.numpy())}
        rows = np.zeros((len(self._active), DETECTIONS_MAX, len(COLUMNS)), np.float32)
        count = np.zeros(len(self._active), np.int32)
        for sensor in sensors:  # rows of slots that have another radar are zeros
            its_rows, its_count = sensor.pull()
            rows += its_rows
            count += its_count
        return {"radar": SensorData(rows, count)}
