"""Rays of every shipped LiDAR and radar, from cars that move along a street."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from schemas.kinds.sensors.radar import PROFILES
from schemas.sections.lidar import Lidar, LidarMount
from twin.bench.radar import RadarBench
from twin.render.trace.geometry import Geometry
from twin.sensors.lidar.lidar import LidarSensor, LidarWeather
from twin.sensors.lidar.profile_file import load_lidar_profile
from twin.sensors.truth import TRUTH
from twin.world.scene import load_scene
from twin.world.street.build import build_world

SCANNERS = ("spinning_16", "spinning_32", "spinning_128")
LIDAR_SLOTS, LIDAR_TICKS = 16, 4
RADAR_SLOTS = 12
WEATHERS = (
    LidarWeather(),
    LidarWeather(extinction_per_m=0.02, wetness=0.2),
    LidarWeather(extinction_per_m=0.006, rain_mm_per_h=8.0, wetness=0.9),
    LidarWeather(extinction_per_m=0.01, snow_mm_per_h=3.0, snow_cover=0.7),
)


def lidar(found: Any) -> None:
    """Points of some sweeps of every profile."""
    world, device = build_world(load_scene("downtown")), wp.get_device(found.device)
    slots = found.count(LIDAR_SLOTS)
    for name in SCANNERS:
        profile = load_lidar_profile(name)
        mount = LidarMount([1.5, 0.1, 1.9], [1.0, -3.0, 5.0], profile=name)
        sensor = LidarSensor(profile, mount, Geometry(world, slots, device), Lidar(truth=True))
        for slot in range(slots):
            sensor.reset(slot, slot + 1, WEATHERS[slot % len(WEATHERS)])
        rng = np.random.default_rng(7)
        rows = np.zeros((slots, len(TRUTH)))
        rows[:, 0] = 10.0 + 250.0 * (np.arange(slots) * 0.618034 % 1.0)
        rows[:, 1] = rng.uniform(-2.0, 2.0, slots)
        yaw = rng.uniform(-0.5, 0.5, slots)
        arrays: list[np.ndarray] = []
        for tick in range(LIDAR_TICKS):
            sensor.geometry.place(world.motion.at(np.full(slots, 3.0 + 0.1 * tick)))
            sensor.air.host["tick"] = tick
            rows[:, 0] += 1.3
            rows[:, 2] = 0.01 * tick
            yaw += 0.03
            rows[:, 5], rows[:, 6] = np.sin(yaw / 2), np.cos(yaw / 2)
            rows[:, 3] = 0.004 * tick
            sensor.scan(wp.array(rows, dtype=wp.float64, device=device))
            points, count = sensor.pull()
            arrays += [points.copy(), count.copy()]
        found.add(f"lidar {name}", *arrays, sample=arrays[-2][1:4, ::7])


def radar(found: Any) -> None:
    """Detections of every profile."""
    for profile in PROFILES:
        bench = RadarBench(found.device, found.count(RADAR_SLOTS), profile)
        found.say(f"radar {profile}", bench.detections(bench.slots)[0])
