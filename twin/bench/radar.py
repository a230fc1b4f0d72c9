"""Radar measurements per second in a shipped street, and the digest of their bytes."""

from __future__ import annotations

import hashlib
import time
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import warp as wp

from twin.base.progress import steps
from twin.render.trace.geometry import Geometry
from twin.sensors.radar.profile import load_radar_profile
from twin.sensors.radar.sensor import RadarSensor
from twin.vehicle.columns import COLUMN, TELEMETRY
from twin.world.scene import Scene, load_scene
from twin.world.street.build import World, build_world

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


class RadarBench:
    """Radars along the road of a scene, with noise, rain, clutter and second ways."""

    def __init__(self, device: str, slots: int, profile: str, scene: str = "downtown") -> None:
        """Build a radar in a scene, with a car per slot.

        Raises:
            ValueError: no such profile or scene; one line.
        """
        self.device, self.slots = wp.get_device(device), slots
        kind, (place, world) = load_radar_profile(profile), _built(scene)
        geometry = Geometry(world, slots, self.device)
        geometry.place(world.motion.at(np.full(slots, 4.0)))
        self.sensor = RadarSensor(kind, geometry)
        rows = np.zeros((slots, len(TELEMETRY)))
        length_m = place.road.end_m - place.road.start_m
        # Places do not depend on the number of slots, so the first slots' bytes do not either.
        shares = (0.1 + 0.618034 * np.arange(slots)) % 0.7
        x_m = place.road.start_m + shares * length_m
        rows[:, COLUMN["x_m"]] = rows[:, COLUMN["com_x_m"]] = x_m
        rows[:, COLUMN["orientation_w"]] = 1.0
        rows[:, COLUMN["velocity_x_mps"]] = _SPEED_MPS
        for slot in range(slots):
            self.sensor.reset(slot, slot + 1)
            self.sensor.mount(slot, (4.1, 0.0, kind.height_m), kind.yaw_deg)
            self.sensor.weather(slot, rain_mm_per_h=_RAIN_MM_PER_H, wetness=0.7)
        self._states = wp.array(rows, dtype=wp.float64, device=self.device)

    def detections(self, first: int) -> tuple[str, int]:
        """SHA-256 of the detections of the ``first`` slots in :data:`TICKS` ticks, and how many."""
        digest, count = hashlib.sha256(), 0
        for tick in range(TICKS):
            self.sensor.state.host["tick"] = tick
            self.sensor.measure(self._states)
            detections, counts = self.sensor.pull()
            digest.update(detections[:first].tobytes())
            count += int(counts[:first].sum())
        return digest.hexdigest(), count

    def rate(self) -> float:
        """Measurements per second of the best round; on a CPU, of one core."""
        clock = time.process_time if self.device.is_cpu else time.perf_counter
        best = 0.0
        for _ in steps("rounds", range(_ROUNDS)):
            wp.synchronize_device(self.device)
            frames, started = 0, clock()
            while (spent := clock() - started) < _ROUND_S:
                self.sensor.measure(self._states)
                wp.synchronize_device(self.device)
                frames += self.slots
            best = max(best, frames / spent)
        return best

    def kernel_times(self) -> list[tuple[str, float]]:
        """Kernels of a measurement and how long each takes [ms], the longest first."""
        spent: dict[str, float] = {}
        clock = time.process_time if self.device.is_cpu else time.perf_counter
        launch = self.sensor.launch

        def timed(kernel: wp.Kernel, *args: Any) -> None:
            wp.synchronize_device(self.device)
            started = clock()
            launch(kernel, *args)
            wp.synchronize_device(self.device)
            name = kernel.key.rpartition("__")[2]
            spent[name] = spent.get(name, 0.0) + clock() - started

        self.sensor.measure(self._states)
        self.sensor.launch = timed
        for _ in range(TICKS):
            self.sensor.measure(self._states)
        self.sensor.launch = launch
        return sorted(((n, 1e3 * s / TICKS) for n, s in spent.items()), key=lambda item: -item[1])


@cache
def _built(scene: str) -> tuple[Scene, World]:
    place = load_scene(scene)
    return place, build_world(place)


def measure(device: str, slots: int, profile: str, scene: str = "downtown") -> RadarFigures:
    """Figures of ``slots`` radars.

    Raises:
        ValueError: no such profile or scene; one line.
    """
    bench = RadarBench(device, slots, profile, scene)
    digest, count = bench.detections(slots)
    name = bench.sensor.profile.radar
    return RadarFigures(device, name, slots, bench.rate(), count / TICKS / slots, digest)
