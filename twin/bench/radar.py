"""Radar measurements per second in a shipped street, and the digest of their bytes."""

from __future__ import annotations

import hashlib
import time
from dataclasses import dataclass

import numpy as np
import warp as wp

from twin.render.trace.geometry import Geometry
from twin.sensors.radar.profile import load_radar_profile
from twin.sensors.radar.sensor import RadarSensor
from twin.vehicle.columns import COLUMN, TELEMETRY
from twin.world.scene import load_scene
from twin.world.street.build import build_world

SLOTS = {"cpu": 1, "cuda": 256}
TARGET = {"cpu": 10.0, "cuda": 2_000.0}
"""Measurements per second: of one CPU core, and of an H200 with 256 slots."""
TICKS = 5
"""Ticks whose detections are digested."""
_ROUNDS, _ROUND_S = 3, 1.0
_SPEED_MPS, _RAIN_MM_PER_H = 14.0, 4.0


@dataclass(frozen=True, slots=True)
class RadarFigures:
    """Figures of the radar bench."""

    device: str
    profile: str
    slots: int
    frames_per_s: float
    detections: float
    """Mean of a measurement."""
    digest: str
    """SHA-256 of the detections of :data:`TICKS` ticks, which is the same on every device."""

    @property
    def target(self) -> float:
        """Measurements per second."""
        return TARGET[self.device.partition(":")[0]]


def measure(device: str, slots: int, profile: str, scene: str = "downtown") -> RadarFigures:
    """Measure with noise, rain, clutter and second ways.

    Raises:
        ValueError: no such profile or scene; one line.
    """
    sensor, states = _rig(device, slots, profile, scene)
    digest, count = _measured(sensor, states)
    rate = _rate(sensor, states, slots, wp.get_device(device))
    name = sensor.profile.radar
    return RadarFigures(str(device), name, slots, rate, count / TICKS / slots, digest)


def digest_of(device: str, slots: int, profile: str, scene: str = "downtown") -> str:
    """SHA-256 of the detections of :data:`TICKS` ticks, as of :func:`measure`."""
    return _measured(*_rig(device, slots, profile, scene))[0]


def _rig(device: str, slots: int, profile: str, scene: str) -> tuple[RadarSensor, wp.array]:
    """Radars along the road of ``scene``, and the states of their vehicles."""
    there = wp.get_device(device)
    kind, place = load_radar_profile(profile), load_scene(scene)
    world = build_world(place)
    geometry = Geometry(world, slots, there)
    geometry.place(world.motion.at(np.full(slots, 4.0)))
    sensor = RadarSensor(kind, geometry)
    rows = np.zeros((slots, len(TELEMETRY)))
    length_m = place.road.end_m - place.road.start_m
    # Places do not depend on the number of slots, so the first slots' bytes do not either.
    shares = (0.1 + 0.618034 * np.arange(slots)) % 0.7
    rows[:, COLUMN["x_m"]] = rows[:, COLUMN["com_x_m"]] = place.road.start_m + shares * length_m
    rows[:, COLUMN["orientation_w"]] = 1.0
    rows[:, COLUMN["velocity_x_mps"]] = _SPEED_MPS
    for slot in range(slots):
        sensor.reset(slot, slot + 1)
        sensor.mount(slot, (4.1, 0.0, kind.height_m), kind.yaw_deg)
        sensor.weather(slot, rain_mm_per_h=_RAIN_MM_PER_H, wetness=0.7)
    return sensor, wp.array(rows, dtype=wp.float64, device=there)


def _measured(sensor: RadarSensor, states: wp.array) -> tuple[str, int]:
    """Digest and number of the detections of some ticks."""
    digest, count = hashlib.sha256(), 0
    for tick in range(TICKS):
        sensor.state.host["tick"] = tick
        sensor.measure(states)
        detections, counts = sensor.pull()
        digest.update(detections.tobytes())
        count += int(counts.sum())
    return digest.hexdigest(), count


def _rate(sensor: RadarSensor, states: wp.array, slots: int, device: wp.Device) -> float:
    """Measurements per second of the best round."""
    clock = time.process_time if device.is_cpu else time.perf_counter
    best = 0.0
    for _ in range(_ROUNDS):
        wp.synchronize_device(device)
        frames, started = 0, clock()
        while (spent := clock() - started) < _ROUND_S:
            sensor.measure(states)
            wp.synchronize_device(device)
            frames += slots
        best = max(best, frames / spent)
    return best


def kernel_times(device: str, slots: int, profile: str) -> list[tuple[str, float]]:
    """Kernels of a measurement and how long each takes [ms], the longest first.

    Raises:
        ValueError: no such profile; one line.
    """
    sensor, states = _rig(device, slots, profile, "downtown")
    there = wp.get_device(device)
    spent: dict[str, float] = {}
    clock = time.process_time if there.is_cpu else time.perf_counter

    def timed(kernel: wp.Kernel, *launch: object) -> None:
        wp.synchronize_device(there)
        started = clock()
        RadarSensor._launch(sensor, kernel, *launch)
        wp.synchronize_device(there)
        name = kernel.key.rpartition("__")[2]
        spent[name] = spent.get(name, 0.0) + clock() - started

    sensor.measure(states)
    sensor._launch = timed  # type: ignore[method-assign]
    for _ in range(TICKS):
        sensor.measure(states)
    return sorted(((n, 1e3 * s / TICKS) for n, s in spent.items()), key=lambda item: -item[1])
