"""The nearest echo of each transducer: one thread per cone, then one per slot gathers the rows."""

from __future__ import annotations

import itertools

import numpy as np
import warp as wp

from schemas.case import Case
from schemas.kinds.sensors.ultrasonic import COLUMNS, TRANSDUCERS
from twin.render.trace.geometry import RayScene, trace
from twin.sensors.data import SensorData
from twin.sensors.ray_sensor import Moment, RayMount, Sight
from twin.sensors.truth import POSITION, rotation_at, vector_at
from twin.vehicle.vehicle_file import Vehicle
from twin.world.mirror import Mirror
from twin.world.sky.sun import Daylight
from twin.world.sky.weather import WeatherParameters

wp.set_module_options({"enable_backward": False})

_HEIGHT_M = 0.5
_ACROSS = (-0.45, -0.15, 0.15, 0.45)
"""Where transducers sit, as shares of the width."""
_TURN_DEG = (-30.0, -8.0, 8.0, 30.0)
"""Where they look."""
_WIDE_DEG = (-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0)
_HIGH_DEG = (-5.0, 0.0, 5.0)
_LEVEL = wp.constant(0.7)
"""Upward share of a normal from which on a face is ground, which throws sound away."""


@wp.kernel
def listen_kernel(
    # model
    scene: RayScene,
    origins: wp.array(dtype=wp.vec3),
    rays: wp.array2d(dtype=wp.vec3),
    # state in
    range_m: wp.array(dtype=wp.float32),
    truth: wp.array2d(dtype=wp.float64),
    # out
    echoes_out: wp.array2d(dtype=wp.float32),
):
    """Distance of the nearest echo [S, T], negative: none; a slot without range is inactive."""
    slot, transducer = wp.tid()
    nearest = wp.float32(-1.0)
    if range_m[slot] > 0.0:
        far = range_m[slot]
        rotation = rotation_at(truth, slot)
        position = vector_at(truth, slot, POSITION)
        origin = wp.vec3(position + wp.quat_rotate(rotation, wp.vec3d(origins[transducer])))
        for k in range(rays.shape[1]):
            direction = wp.vec3(wp.quat_rotate(rotation, wp.vec3d(rays[transducer, k])))
            hit = trace(scene, slot, origin, direction, far)
            if hit.found and wp.abs(hit.normal[2]) < _LEVEL:
                far = hit.t
                nearest = hit.t
    echoes_out[slot, transducer] = nearest


@wp.kernel
def gather_kernel(
    # model
    bearings_rad: wp.array(dtype=wp.float32),
    # state in
    echoes: wp.array2d(dtype=wp.float32),
    # out
    rows_out: wp.array3d(dtype=wp.float32),
    count_out: wp.array(dtype=wp.int32),
):
    """Rows of those transducers that heard something, in their order; zeros behind them."""
    slot = wp.tid()
    count = wp.int32(0)
    for transducer in range(echoes.shape[1]):
        rows_out[slot, transducer, 0] = 0.0
        rows_out[slot, transducer, 1] = 0.0
        if echoes[slot, transducer] >= 0.0:
            rows_out[slot, count, 0] = echoes[slot, transducer]
            rows_out[slot, count, 1] = bearings_rad[transducer]
            count += 1
    count_out[slot] = count


class Ranger:
    """The rangers of all slots, as :class:`twin.sensors.ray_sensor.RaySensor`."""

    needs_truth = True

    def __init__(self, mount: RayMount, hz: int) -> None:
        """``hz``: readings per second [Hz]."""
        self.every = mount.case.rig.control_hz // hz
        self._scene = mount.geometry.scene
        self._device, slots = mount.geometry.device, mount.geometry.slots
        origins, bearings_rad, rays = _cones(mount.vehicle)
        self._origins = wp.array(origins, dtype=wp.vec3, device=self._device)
        self._rays = wp.array(rays, dtype=wp.vec3, device=self._device)
        self._bearings = wp.array(bearings_rad, dtype=wp.float32, device=self._device)
        self._range = Mirror((slots,), wp.float32, self._device)
        self._range_m = np.zeros(slots)
        """Of the slots' cases; those that are held keep theirs here."""
        self._echoes = wp.zeros((slots, TRANSDUCERS), dtype=wp.float32, device=self._device)
        shape = (slots, TRANSDUCERS, len(COLUMNS))
        shared = mount.buffers.get("ultrasonic")
        self._rows = Mirror(shape, wp.float32, self._device, shared, large=True)
        self._count = wp.zeros(slots, dtype=wp.int32, device=self._device)
        wp.load_module(listen_kernel.module.name, device=self._device)

    def reset(self, slot: int, case: Case) -> None:
        """Begin a case."""
        self._range_m[slot] = case.variation.sensors.ultrasonic.range_m
        self._range.host[slot] = self._range_m[slot]

    def light(
        self,
        slot: int,
        light: Daylight,
        weather: WeatherParameters,
        wind_towards: tuple[float, float],
    ) -> None:
        """Sound is the same in any light."""

    def clear(self, slot: int) -> None:
        """Make a slot inactive."""
        self._range.host[slot] = 0.0

    def hold(self, slot: int, *, held: bool) -> None:
        """Leave a slot out of the readings, or take it in again."""
        self._range.host[slot] = 0.0 if held else self._range_m[slot]

    def moved(self, slot: int) -> None:
        """Nothing leads from one reading to the next."""

    def advance(self, now: Moment) -> None:
        """A reading depends on nothing between it and the last."""

    def launch(self, sight: Sight) -> None:
        """Begin a reading."""
        self._range.push()
        wp.launch(
            listen_kernel,
            self._echoes.shape,
            inputs=[self._scene, self._origins, self._rays, self._range.device, sight.truth],
            outputs=[self._echoes],
            device=self._device,
        )
        wp.launch(
            gather_kernel,
            self._echoes.shape[0],
            inputs=[self._bearings, self._echoes],
            outputs=[self._rows.device, self._count],
            device=self._device,
        )

    def read(self) -> dict[str, SensorData]:
        """Echoes, and how many each slot has."""
        return {"ultrasonic": SensorData.mirrored(self._rows, self._count.numpy())}


def _cones(vehicle: Vehicle) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places [T, 3], bearings [T] and unit rays [T, R, 3] in the vehicle's axes."""
    front, rear = vehicle.front_offset_m, -vehicle.rear_overhang_m
    origins, bearings = [], []
    for x_m, back_deg, side in ((front, 0.0, 1.0), (rear, 180.0, -1.0)):
        for across, turn_deg in zip(_ACROSS, _TURN_DEG, strict=True):
            origins.append((x_m, side * across * vehicle.width_m, _HEIGHT_M))
            bearings.append(np.radians(turn_deg + back_deg))
    grid = np.radians(list(itertools.product(_WIDE_DEG, _HIGH_DEG)))
    yaw = np.array(bearings)[:, None] + grid[:, 0]
    up = np.broadcast_to(grid[:, 1], yaw.shape)
    rays = np.stack([np.cos(up) * np.cos(yaw), np.cos(up) * np.sin(yaw), np.sin(up)], axis=-1)
    wrapped = np.remainder(np.array(bearings) + np.pi, 2 * np.pi) - np.pi
    return np.array(origins), wrapped, rays
