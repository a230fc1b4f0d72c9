"""LiDAR rays per second: bare ranges, and with everything; beside newton on the same triangles.

Rates are of device work, the best of several rounds: other load only ever slows a round down. On
the CPU time is that of the core (Warp uses one): waiting for other programs does not count.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from schemas.sections.lidar import Lidar, LidarMount, LidarProfile
from twin.base.progress import steps
from twin.bench.newton_lidar import MISS, PEER, NewtonLidar
from twin.render.trace.geometry import Geometry
from twin.sensors.lidar.lidar import LidarSensor, LidarWeather
from twin.sensors.lidar.packet import PACKET
from twin.sensors.lidar.profile_file import load_lidar_profile
from twin.sensors.truth import TRUTH
from twin.world.scene import Scene, load_scene
from twin.world.street.build import World, build_world

TARGETS = {"cpu": 6e6, "cuda": 3e9}
"""Rays per second with everything, on one core and on one H200 at 256 slots."""
RATIO_TARGETS = {"cpu": 1.8, "cuda": None}
"""Bare ranges over newton's."""
SLOTS = {"cpu": 8, "cuda": 256}
TILES = ((8, 4), (16, 2), (32, 1), (4, 8))
"""Tiles of a warp's 32 rays that :func:`time_tiles` tries."""
BLOCKS = {"cpu": (128,), "cuda": (64, 128)}
"""Blocks that it tries."""
_ROUNDS = 7
_ROUND_S = 0.3
_MOUNT = LidarMount(position_m=[1.5, 0.0, 1.9], profile="spinning_32")

WEATHER = LidarWeather(extinction_per_m=2.996 / 500.0, rain_mm_per_h=2.0, wetness=0.6)
"""Light rain in light fog: every part of the sensor has work."""


@dataclass(frozen=True, slots=True)
class LidarFigures:
    """Figures of the LiDAR bench."""

    device: str
    slots: int
    profile: LidarProfile
    triangles: int
    objects: int
    bare_rays_per_s: float
    """Ranges of the static triangles, without motion."""
    rays_per_s: float
    """Points with intensity, noise, weather, motion and objects."""
    peer_rays_per_s: float | None
    """Newton's ranges of the same static triangles; None without it."""
    peer_order: str
    peer_differs: float
    """Share of rays whose ranges differ by more than 1 cm from newton's."""
    sensor_bytes: int
    """Device memory of the sensor [bytes]."""

    @property
    def kind(self) -> str:
        """``cpu`` or ``cuda``."""
        return self.device.partition(":")[0]

    @property
    def target(self) -> float:
        """Rays per second to reach on this kind of device."""
        return TARGETS[self.kind]

    @property
    def ratio(self) -> float | None:
        """Bare ranges per range of newton."""
        return self.bare_rays_per_s / self.peer_rays_per_s if self.peer_rays_per_s else None

    @property
    def missed(self) -> list[str]:
        """Targets that were not reached, in words."""
        missed = []
        if self.rays_per_s < self.target:
            missed.append(f"{self.target:,.0f} rays/s")
        wanted = RATIO_TARGETS[self.kind]
        if wanted and self.ratio is not None and self.ratio < wanted:
            missed.append(f"{wanted:g} times {PEER}")
        return missed


def measure(
    device: str, slots: int, profile: str = "spinning_32", scene: str = "downtown"
) -> LidarFigures:
    """Sweep ``slots`` cars spread along ``scene``; newton's ranges if it is installed.

    Raises:
        ValueError: unknown profile or scene; one line.
    """
    kind, target = load_lidar_profile(profile), load_scene(scene)
    world = build_world(target)
    warp_device = wp.get_device(device)
    positions = _positions(target, slots)
    bare = _sensor(kind, world, slots, Lidar(noise=False, motion=False, weather=False), warp_device)
    truth = _truth(positions, 0.0, warp_device)
    bare.scan(truth)
    bare_rate = _rate(bare._cast, slots * kind.channels * kind.columns, warp_device)
    peer, order, differs = _peer(kind, world, positions, bare, device)
    # Objects as they are some seconds after the start.
    full = _sensor(kind, world, slots, Lidar(), warp_device)
    full.geometry.place(world.motion.at(np.full(slots, 5.0)))
    full.scan(_truth(positions, 0.0, warp_device))
    later = _truth(positions + np.array([1.2, 0.05, 0.0]), 0.02, warp_device)
    rate = _rate(lambda: full.scan(later), slots * kind.channels * kind.columns, warp_device)
    return LidarFigures(
        device=device,
        slots=slots,
        profile=kind,
        triangles=len(world.mesh.faces),
        objects=world.motion.count,
        bare_rays_per_s=bare_rate,
        rays_per_s=rate,
        peer_rays_per_s=peer,
        peer_order=order,
        peer_differs=differs,
        sensor_bytes=full.device_bytes,
    )


def time_tiles(
    device: str, slots: int, profile: str = "spinning_32", scene: str = "downtown"
) -> dict[str, float]:
    """Bare ranges per second by shape of the tiles (on the CPU only shapes that packets fill) and,
    on a GPU, size of the blocks."""
    kind, target = load_lidar_profile(profile), load_scene(scene)
    world, warp_device = build_world(target), wp.get_device(device)
    positions = _positions(target, slots)
    quiet = Lidar(noise=False, motion=False, weather=False)
    rates = {}
    for tile in TILES:
        if warp_device.is_cpu and (tile[0] % PACKET[0] or tile[1] % PACKET[1]):
            continue
        for block in BLOCKS["cpu" if warp_device.is_cpu else "cuda"]:
            sensor = _sensor(kind, world, slots, quiet, warp_device, tile=tile, block=block)
            sensor.scan(_truth(positions, 0.0, warp_device))
            rays = slots * kind.channels * kind.columns
            rate = _rate(sensor._cast, rays, warp_device)
            rates[f"{tile[0]}x{tile[1]}, blocks of {block}"] = rate
    return rates


def as_json(found: LidarFigures) -> dict[str, object]:
    """Figures for ``--output json``."""
    return {
        "device": found.device,
        "slots": found.slots,
        "profile": found.profile.lidar,
        "channels": found.profile.channels,
        "columns": found.profile.columns,
        "triangles": found.triangles,
        "objects": found.objects,
        "rays_per_s": found.rays_per_s,
        "target_rays_per_s": found.target,
        "bare_rays_per_s": found.bare_rays_per_s,
        "newton_rays_per_s": found.peer_rays_per_s,
        "newton_order": found.peer_order,
        "newton_differs": found.peer_differs,
        "ratio": found.ratio,
        "sensor_bytes": found.sensor_bytes,
    }


def lines(found: LidarFigures) -> list[str]:
    """Figures in lines for people."""
    kind = found.profile
    text = [
        f"{found.rays_per_s:,.0f} rays/s with intensity, noise, weather and motion on "
        f"{found.device} (target {found.target:,.0f})",
        f"{found.slots} slots x {kind.channels} channels x {kind.columns} columns ({kind.lidar}), "
        f"{found.triangles:,} triangles, {found.objects} objects, "
        f"{found.sensor_bytes / 1e6:,.0f} MB",
        f"{found.bare_rays_per_s:,.0f} bare ranges/s",
    ]
    if found.peer_rays_per_s is None:
        text.append(f"no ratio: {PEER} is not installed")
    else:
        text.append(
            f"{found.ratio:.2f} times the {found.peer_rays_per_s:,.0f} ranges/s of {PEER} "
            f"({found.peer_order}) in the same run; {100 * found.peer_differs:.3f} % of the ranges "
            "differ by more than 1 cm"
        )
    return text


def _positions(scene: Scene, slots: int) -> np.ndarray:
    """Rear axles spread along the street [S, 3]."""
    positions = np.zeros((slots, 3))
    length = scene.road.end_m - scene.road.start_m
    shares = np.arange(slots) / max(1, slots - 1)
    positions[:, 0] = scene.road.start_m + (0.1 + 0.7 * shares) * length
    return positions


def _sensor(
    kind: LidarProfile,
    world: World,
    slots: int,
    lidar: Lidar,
    device: wp.Device,
    **shape: Any,
) -> LidarSensor:
    geometry = Geometry(world, slots, device)
    sensor = LidarSensor(kind, _MOUNT, geometry, lidar, **shape)
    for slot in range(slots):
        sensor.reset(slot, slot + 1, WEATHER)
    return sensor


def _truth(positions_m: np.ndarray, yaw_rad: float, device: wp.Device) -> wp.array:
    rows = np.zeros((len(positions_m), len(TRUTH)))
    rows[:, :3] = positions_m
    rows[:, 5], rows[:, 6] = np.sin(yaw_rad / 2), np.cos(yaw_rad / 2)
    return wp.array(rows, dtype=wp.float64, device=device)


def _rate(launch: Callable[[], object], rays: int, device: wp.Device) -> float:
    """Rays per second of the best round."""
    clock = time.process_time if device.is_cpu else time.perf_counter
    launch()
    wp.synchronize_device(device)
    best = 0.0
    for _ in steps("rounds", range(_ROUNDS)):
        launches, started = 0, clock()
        while (spent := clock() - started) < _ROUND_S:
            for _ in range(1 if device.is_cpu else 5):
                launch()
                launches += 1
            wp.synchronize_device(device)
        best = max(best, launches * rays / spent)
    return best


def _peer(
    kind: LidarProfile, world: World, positions_m: np.ndarray, sensor: LidarSensor, device: str
) -> tuple[float | None, str, float]:
    """Newton's best rate, the order it had it with, and the share of ranges that differ."""
    if importlib.util.find_spec(PEER) is None:
        return None, "", 0.0
    phi, theta = np.meshgrid(np.radians(kind.phis_deg), np.radians(kind.thetas_deg), indexing="ij")
    rays = (np.cos(theta) * np.cos(phi), np.sin(theta) * np.cos(phi), -np.sin(phi))
    eyes = positions_m + _MOUNT.position_m
    peer = NewtonLidar(world.mesh, np.stack(rays, -1), eyes, kind.range_max_m, device)
    count = len(eyes) * kind.channels * kind.columns
    rates = {name: _rate(launch, count, sensor._device) for name, launch in peer.orders().items()}
    best = max(rates, key=lambda name: rates[name])
    theirs = peer.ranges().reshape(len(eyes), -1)
    theirs = np.where(theirs == MISS, kind.range_max_m, theirs)
    ours = sensor._hits.numpy()["t"].reshape(theirs.shape)
    return rates[best], best, float((np.abs(theirs - ours) > 0.01).mean())
