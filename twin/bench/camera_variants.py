"""Alternatives of the render kernels, timed in one run."""

from __future__ import annotations

import dataclasses

import numpy as np
import warp as wp

from twin.bench.camera import CAMERA, HFOV_DEG, SUN, VEHICLE, Size, best_rate, eyes, views
from twin.bench.lambert import LambertCamera, Way
from twin.render.bvh import Shape
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.scene import load_scene
from twin.world.street import build_world

WAYS: dict[str, Way] = {
    "warp leaf 2": Way(traversal="warp", leaf=2),
    "warp leaf 2 block 64": Way(traversal="warp", leaf=2, block=64),
    "own": Way(),
    "own leaf 1": Way(shape=Shape(4, 1, packed=False)),
    "own leaf 4": Way(shape=Shape(4, 4, packed=False)),
    "own leaf 8": Way(shape=Shape(4, 8, packed=False)),
    "own block 64": Way(block=64),
    "own block 128": Way(block=128),
    "own fast math": Way(fast_math=True),
    "own 6 blocks of 128": Way(block=128, registers=6),
    "own 8 blocks of 128": Way(block=128, registers=8),
    "own 10 blocks of 128": Way(block=128, registers=10),
    "own tile 4x8": Way(tile=(4, 8)),
    "own tile 16x2": Way(tile=(16, 2)),
    "own tile 16x8": Way(tile=(16, 8)),
}
"""What is tried on a GPU; on a CPU the hierarchies' shape is fixed by the vector code."""
CPU_WAYS: dict[str, Way] = {
    "warp leaf 8": Way(traversal="warp", leaf=8),
    "own": Way(),
    "own scalar": Way(traversal="scalar", shape=Shape(4, 2, packed=False)),
    "own tile 16x8": Way(tile=(16, 8)),
    "own tile 32x1": Way(tile=(32, 1)),
}


def time_variants(device: str, size: Size, rounds: int = 3) -> dict[str, object]:
    """Lambert frames per second of every way, by name, with the share of pixels that differ by more
    than one level from the first way's; a way that fails says why."""
    world = build_world(load_scene("downtown"))
    at = views(world, size.slots)
    mount = load_vehicle(VEHICLE).camera(CAMERA).position_m
    ways = CPU_WAYS if wp.get_device(device).is_cpu else WAYS
    first: np.ndarray | None = None
    table: dict[str, object] = {"device": device, "size": dataclasses.asdict(size)}
    for name, way in ways.items():
        try:
            camera = LambertCamera(
                world,
                eyes(at, mount),
                at.yaw_rad,
                (size.width, size.height),
                HFOV_DEG,
                SUN,
                device,
                way,
            )
            rate = best_rate(camera.launch, wp.get_device(device), rounds) * size.slots
            image = camera.image()[:4, ..., 0].astype(int)
        except Exception as error:  # the table shows what this device cannot do
            table[name] = str(error)
            continue
        first = image if first is None else first
        table[name] = {
            "frames_per_s": round(rate, 1),
            "differs": float((np.abs(image - first) > 1).mean()),
        }
    return table
