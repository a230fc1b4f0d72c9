"""The cameras of a rig: where they sit, their arrays, and each with its boxes as a ray sensor."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from schemas.campaign import Camera
from schemas.case import Case
from schemas.identity import case_stream
from schemas.kinds.picture import MAIN, OUTPUTS_BY_NAME
from schemas.messages import CameraSite, Lights
from twin.fabric.frames import FrameChannel
from twin.render.camera import RayCamera
from twin.render.light.light import advance_light, begin_sky, fill_light, fill_sky, switch_lamps
from twin.render.light.precipitation import DROPS_MASK
from twin.render.looks import has_looks
from twin.render.memory import MemoryRow, camera_rows
from twin.sensors.camera.boxes import BoxSensor
from twin.sensors.data import SensorData
from twin.sensors.mount import KeyOf
from twin.sensors.ray_sensor import Moment, RayMount, Sight
from twin.vehicle.vehicle_file import Vehicle
from twin.world.sky.sun import Daylight
from twin.world.sky.weather import WeatherParameters
from twin.world.street.build import World

HAZARD_PERIOD_NS = 666_000_000
"""Blink period of hazard lamps: 90 per minute (UN R48 asks for 60 to 120) [ns]."""

_ALOFT = ("cloud_offset", "fallen_m", "time_s")
"""What :func:`advance_light` moves on."""


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


class Cameras:
    """Cameras as :class:`twin.sensors.ray_sensor.RayRig`."""

    def channels(
        self,
        case: Case,
        vehicle: Vehicle,  # noqa: ARG002 - pictures are as the campaign says
        slots: int,
    ) -> list[FrameChannel]:
        """Pictures and further outputs [S, H, W, ...]."""
        found = []
        for camera, suffix in _cameras(case):
            for kind in (MAIN, *(OUTPUTS_BY_NAME[output] for output in camera.outputs)):
                shape = kind.shape(slots, camera.height, camera.width)
                found.append(FrameChannel(kind.name + suffix, shape, kind.dtype))
        return found

    def memory(
        self,
        case: Case,
        vehicle: Vehicle,  # noqa: ARG002 - pictures are as the campaign says
        world: World,
    ) -> list[MemoryRow]:
        """Rays, pictures, light and effects of each."""
        return [
            row
            for camera in case.rig.seeing
            for row in camera_rows(camera, instances=len(world.classes), details=has_looks(world))
        ]

    def build(self, mount: RayMount) -> list[MountedCamera]:
        """Allocate and compile.

        Raises:
            ValueError: the vehicle has no such camera, or a buffer or lens does not fit; one line.
        """
        return [MountedCamera(mount, camera, suffix) for camera, suffix in _cameras(mount.case)]


class MountedCamera:
    """One camera with its boxes, in all slots."""

    needs_truth = False

    def __init__(self, mount: RayMount, spec: Camera, suffix: str) -> None:
        """``suffix``: what stands behind the kind in the names of its messages."""
        geometry, buffers = mount.geometry, mount.buffers
        self.every = mount.case.rig.control_hz // spec.hz
        self.camera = RayCamera(
            geometry,
            mount.world,
            mount.scene.furniture,
            spec,
            mount.vehicle.camera(spec.name),
            tuple(mount.vehicle.headlamps_m),
            buffers.get(f"camera{suffix}"),
            {o: buffers[o + suffix] for o in spec.outputs if o + suffix in buffers},
        )
        self._spec = spec
        self._stream = f"camera/{spec.name}"
        self._suffix = suffix
        kinds = ("camera", "boxes", *spec.outputs)
        self.messages = frozenset(f"{kind}{suffix}" for kind in kinds)
        self._boxes = BoxSensor(geometry.classes, geometry.slots, geometry.device)
        self._lamps: list[Lights | None] = [None] * geometry.slots
        """Written last, per slot."""
        self._aloft: dict[int, list[np.ndarray]] = {}
        """Clouds and drops of slots that are held."""

    def reset(self, slot: int, case: Case) -> None:
        """Begin a case; :meth:`light` must follow."""
        row = self.camera.lights.host[slot]
        row["noise"] = int(self._spec.noise)
        row["key"] = case_stream(case, self._stream)
        row["active"] = 1
        begin_sky(row, case_stream(case, "clouds"))
        self.camera.reset(slot)

    def redraw(self, slot: int, key: KeyOf) -> None:
        """Draw by another key. The drops that hang in the air stay: of the key they have the lowest
        bits, and those are the case's from its start."""
        row = self.camera.lights.host[slot]
        drops = int(row["key"]) & DROPS_MASK
        row["key"] = key(self._stream) & ~DROPS_MASK | drops

    def light(
        self,
        slot: int,
        light: Daylight,
        weather: WeatherParameters,
        wind_towards: tuple[float, float],
    ) -> None:
        """Light and air of a slot from now on."""
        fill_light(self.camera.lights.host[slot], light, weather, wind_towards)
        fill_sky(self.camera.sky_table.host[slot], light)
        self.camera.sky_stale = True

    def clear(self, slot: int) -> None:
        """Make a slot inactive."""
        self.camera.lights.host[slot]["active"] = 0
        self.camera.clear(slot)
        self._aloft.pop(slot, None)

    def hold(self, slot: int, *, held: bool) -> None:
        """Leave a slot out of pictures, or take it in again as it was."""
        row = self.camera.lights.host[slot]
        row["active"] = int(not held)
        self.camera.hold(slot, held=held)
        # Clouds and drops move with every tick of the others; weather set meanwhile stays.
        if held:
            self._aloft[slot] = [row[name].copy() for name in _ALOFT]
            return
        for name, value in zip(_ALOFT, self._aloft.pop(slot), strict=True):
            row[name] = value

    def save(self, slot: int) -> dict[str, np.ndarray]:
        """Keys, light, clouds and drops, and the poses of the last picture."""
        light = self.camera.lights.host[slot].copy()
        return {"light": light, **self.camera.save(slot)}

    def restore(self, slot: int, saved: dict[str, np.ndarray]) -> None:
        """Go on with them; lamps are written anew."""
        self.camera.lights.host[slot] = saved["light"]
        self._lamps[slot] = None
        self.camera.restore(slot, saved)

    def moved(self, slot: int) -> None:
        """The ego was put elsewhere."""
        self.camera.reset(slot)

    def advance(self, now: Moment) -> None:
        """Clouds and drops move on."""
        advance_light(self.camera.lights.host, now.sim_time_ns / 1e9)

    def launch(self, sight: Sight) -> None:
        """Begin a picture and its boxes."""
        self._switch(sight)
        self.camera.launch(sight.pose)
        self._boxes.launch(self.camera.boxes)

    def read(self) -> dict[str, SensorData]:
        """Pictures by output, and boxes."""
        readings = {
            f"{kind or 'camera'}{self._suffix}": SensorData.mirrored(mirror)
            for kind, mirror in self.camera.pictures.items()
        }
        boxes, count = self._boxes.read()
        return {**readings, f"boxes{self._suffix}": SensorData(boxes, count)}

    def _switch(self, sight: Sight) -> None:
        """Write what changes from frame to frame: tick, lamps, blinking."""
        rows = self.camera.lights.host
        rows["tick"] = sight.now.tick
        rows["hazard"] = 2 * (sight.now.sim_time_ns % HAZARD_PERIOD_NS) < HAZARD_PERIOD_NS
        for slot, (lamps, written) in enumerate(zip(sight.lights, self._lamps, strict=True)):
            if lamps is not None and lamps != written:
                switch_lamps(rows[slot], lamps)
                self._lamps[slot] = lamps


def _cameras(case: Case) -> Iterator[tuple[Camera, str]]:
    """The cameras, and what stands behind the kind in the names of their messages."""
    for index, camera in enumerate(case.rig.seeing):
        yield camera, f".{camera.name}" if index else ""


CAMERAS = Cameras()
