"""What looks at the world: cameras and lidars of a rig, each at its own rate, one geometry."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import warp as wp

from schemas.campaign import Camera
from schemas.case import Case
from schemas.identity import stream_key
from schemas.messages import CameraSite, LidarSite, Lights
from schemas.sections.lidar import lidar_columns
from twin.actors.motion import Placement
from twin.fabric.frames import FrameChannel
from twin.render.camera import RayCamera
from twin.render.light.light import advance_light, begin_sky, fill_light, fill_sky, switch_lamps
from twin.render.memory import check_free, free_bytes
from twin.render.trace.geometry import Geometry
from twin.sensors.boxes import BoxSensor
from twin.sensors.data import SensorData
from twin.sensors.lidar.lidar import LidarSensor, LidarWeather, mounted_profile
from twin.sensors.rig_memory import rig_memory
from twin.vehicle.vehicle_file import Vehicle
from twin.world.mirror import Mirror
from twin.world.scene import Scene
from twin.world.sky.sun import Daylight
from twin.world.sky.weather import WeatherParameters
from twin.world.street.build import World

HAZARD_PERIOD_NS = 666_000_000
"""Blink period of hazard lamps: 90 per minute (UN R48 asks for 60 to 120) [ns]."""

_DTYPES = {"depth": "<f4", "instance": "<i4", "semantic": "|u1", "normal": "<f4", "flow": "<f4"}
_DEPTHS = {"normal": (3,), "flow": (2,)}


@dataclass(frozen=True, slots=True)
class Moment:
    """Where the slots' cases stand."""

    tick: np.ndarray
    """int32 [S]"""
    sim_time_ns: np.ndarray
    """int64 [S]"""
    active: np.ndarray
    """bool [S]"""


def frame_channels(case: Case, vehicle: Vehicle, slots: int) -> list[FrameChannel]:
    """The arrays of a rig's cameras and lidars, large enough to be worth sharing.

    Raises:
        ValueError: the vehicle has no such lidar; one line.
    """
    channels = []
    for camera, suffix in _cameras(case):
        size = (slots, camera.height, camera.width)
        channels.append(FrameChannel(f"camera{suffix}", (*size, 3), "|u1"))
        for output in camera.outputs:
            shape = (*size, *_DEPTHS.get(output, ()))
            channels.append(FrameChannel(f"{output}{suffix}", shape, _DTYPES[output]))
    for site in lidar_sites(case, vehicle):
        shape = (slots, site.channels * site.columns, len(site.fields))
        channels.append(FrameChannel(site.message, shape, "<f4"))
    return channels


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


def camera_sites(case: Case, vehicle: Vehicle) -> list[CameraSite]:
    """What a stack may know of the cameras.

    Raises:
        ValueError: the vehicle has no such camera; one line.
    """
    sites = []
    for camera, suffix in _cameras(case):
        mount = vehicle.camera(camera.name)
        sites.append(
            CameraSite(
                name=camera.name,
                message=f"camera{suffix}",
                width=camera.width,
                height=camera.height,
                hz=camera.hz,
                hfov_deg=camera.hfov_deg,
                position_m=mount.position_m,
                rotation_deg=mount.rotation_deg,
                lens=mount.lens,
            )
        )
    return sites


def _cameras(case: Case) -> Iterator[tuple[Camera, str]]:
    """The cameras, and what stands behind the kind in the names of their messages."""
    for index, camera in enumerate(case.rig.seeing):
        yield camera, f".{camera.name}" if index else ""


_ALOFT = ("cloud_offset", "fallen_m", "time_s")
"""What :func:`advance_light` moves on."""


@dataclass(slots=True)
class _Eye:
    """One camera with its boxes."""

    spec: Camera
    suffix: str
    every: int
    camera: RayCamera
    boxes: BoxSensor
    lamps: list[Lights | None]
    """Written last, per slot."""


@dataclass(slots=True)
class _Scanner:
    """One lidar."""

    site: LidarSite
    every: int
    sensor: LidarSensor


class ExteroceptiveSuite:
    """Cameras and lidars of all slots."""

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
            ValueError: the vehicle has no such camera or lidar, or the GPU has too little memory;
                one line.
        """
        _check_memory(case, vehicle, world, slots, device)
        self._geometry = Geometry(world, slots, device)
        self._eyes = []
        for camera, suffix in _cameras(case):
            eye = RayCamera(
                self._geometry,
                world,
                scene.furniture,
                camera,
                vehicle.camera(camera.name),
                tuple(vehicle.headlamps_m),
                buffers.get(f"camera{suffix}"),
                {o: buffers[o + suffix] for o in camera.outputs if o + suffix in buffers},
            )
            boxes = BoxSensor(self._geometry.classes, slots, device)
            every = case.rig.control_hz // camera.hz
            self._eyes.append(_Eye(camera, suffix, every, eye, boxes, [None] * slots))
        self._scanners = []
        self.lidar_sites = lidar_sites(case, vehicle)
        for lidar, site in zip(case.rig.lidars, self.lidar_sites, strict=True):
            mount = vehicle.lidar(lidar.name)
            profile = mounted_profile(mount)
            out = buffers.get(site.message)
            sensor = LidarSensor(profile, mount, self._geometry, lidar, out)
            self._scanners.append(_Scanner(site, case.rig.control_hz // site.hz, sensor))
        self._aloft: dict[tuple[int, int], list[np.ndarray]] = {}
        """By slot that is held and eye."""
        self.needs_truth = bool(self._scanners)
        """:meth:`read` needs the vehicles' truth."""
        rates = [*(eye.every for eye in self._eyes), *(s.every for s in self._scanners)]
        self.period = math.lcm(*rates)
        """Control periods after which all are due together again."""

    def reset(self, slot: int, case: Case) -> None:
        """Begin a case; :meth:`light` must follow."""
        for eye in self._eyes:
            row = eye.camera.lights.host[slot]
            row["noise"] = int(eye.spec.noise)
            row["key"] = stream_key(case.variation.seed, case.id, f"camera/{eye.spec.name}")
            row["active"] = 1
            begin_sky(row, stream_key(case.variation.seed, case.id, "clouds"))
            eye.camera.reset(slot)
        for scanner in self._scanners:
            key = stream_key(case.variation.seed, case.id, f"lidar/{scanner.site.name}")
            scanner.sensor.reset(slot, key)

    def light(
        self,
        slot: int,
        light: Daylight,
        weather: WeatherParameters,
        wind_towards: tuple[float, float],
    ) -> None:
        """Light and air of a slot from now on; ``wind_towards``: unit vector along the wind."""
        for eye in self._eyes:
            fill_light(eye.camera.lights.host[slot], light, weather, wind_towards)
            fill_sky(eye.camera.sky_table.host[slot], light)
            eye.camera.sky_stale = True
        if self._scanners:
            air = LidarWeather(
                extinction_per_m=weather.extinction_per_m,
                rain_mm_per_h=weather.rain_mm_per_h,
                snow_mm_per_h=weather.snow_mm_per_h,
                wetness=weather.wetness,
                snow_cover=weather.snow_cover,
            )
            for scanner in self._scanners:
                scanner.sensor.weather(slot, air)

    def clear(self, slot: int) -> None:
        """Make a slot inactive."""
        for index, eye in enumerate(self._eyes):
            eye.camera.lights.host[slot]["active"] = 0
            eye.camera.clear(slot)
            self._aloft.pop((slot, index), None)
        for scanner in self._scanners:
            scanner.sensor.clear(slot)

    def hold(self, slot: int, *, held: bool) -> None:
        """Leave a slot out of pictures and sweeps, or take it in again as it was."""
        for index, eye in enumerate(self._eyes):
            row = eye.camera.lights.host[slot]
            row["active"] = int(not held)
            eye.camera.hold(slot, held=held)
            # Clouds and drops move with every tick of the others; weather set meanwhile stays.
            if held:
                self._aloft[slot, index] = [row[name].copy() for name in _ALOFT]
                continue
            for name, value in zip(_ALOFT, self._aloft.pop((slot, index)), strict=True):
                row[name] = value
        for scanner in self._scanners:
            scanner.sensor.air.host[slot]["active"] = int(not held)

    def moved(self, slot: int) -> None:
        """The ego was put elsewhere: nothing leads from the last picture and sweep to the next."""
        for eye in self._eyes:
            eye.camera.reset(slot)
        for scanner in self._scanners:
            scanner.sensor.air.host[slot]["fresh"] = 1

    def read(
        self,
        now: Moment,
        lights: list[Lights | None],
        placement: Placement,
        pose: wp.array,
        truth: wp.array | None,
    ) -> dict[str, SensorData]:
        """Pictures and points that are due; to be called at every tick, before the step.

        Args:
            now: ticks and times of the slots.
            lights: lamps of each slot's ego; None where inactive.
            placement: where the objects are.
            pose: vehicle states on the device [S, T].
            truth: rows of :class:`twin.sensors.vehicle_truth.VehicleTruth`, for lidars.
        """
        if not now.active.any():
            return {}
        for eye in self._eyes:
            advance_light(eye.camera.lights.host, now.sim_time_ns / 1e9)
        phase = now.tick[now.active] % self.period
        assert (phase == phase[0]).all(), "active slots are not due for their frames together"
        due = [eye for eye in self._eyes if phase[0] % eye.every == 0]
        sweeping = [s for s in self._scanners if phase[0] % s.every == 0]
        if not due and not sweeping:
            return {}
        self._geometry.place(placement)
        # All that is to be computed first: the first result that is asked for waits for the GPU.
        for eye in due:
            _switch(eye, now, lights)
            eye.camera.launch(pose)
            eye.boxes.launch(eye.camera.boxes)
        for scanner in sweeping:
            assert truth is not None
            scanner.sensor.air.host["tick"] = now.tick
            scanner.sensor.scan(truth)
        readings = {}
        for eye in due:
            for kind, mirror in eye.camera.pictures.items():
                found = SensorData(mirror.pull, device=_on_gpu(mirror))
                readings[f"{kind or 'camera'}{eye.suffix}"] = found
            boxes, count = eye.boxes.read()
            readings[f"boxes{eye.suffix}"] = SensorData(boxes, count)
        for scanner in sweeping:
            mirror, count = scanner.sensor.mirror, scanner.sensor.count.numpy()
            readings[scanner.site.message] = SensorData(mirror.pull, count, _on_gpu(mirror))
        return readings


def _on_gpu(mirror: Mirror) -> wp.array | None:
    """Where it lies, if that is another memory than the host's."""
    return None if mirror.device.device.is_cpu else mirror.device


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


def _switch(eye: _Eye, now: Moment, lights: list[Lights | None]) -> None:
    """Write what changes from frame to frame: tick, lamps, blinking."""
    rows = eye.camera.lights.host
    rows["tick"] = now.tick
    rows["hazard"] = 2 * (now.sim_time_ns % HAZARD_PERIOD_NS) < HAZARD_PERIOD_NS
    for slot, (lamps, written) in enumerate(zip(lights, eye.lamps, strict=True)):
        if lamps is not None and lamps != written:
            switch_lamps(rows[slot], lamps)
            eye.lamps[slot] = lamps
