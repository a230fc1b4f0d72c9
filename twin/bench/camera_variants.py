"""Alternatives of the render kernels, timed in one run."""

from __future__ import annotations

import dataclasses
from dataclasses import replace

import numpy as np
import warp as wp

from twin.actors.motion import Still
from twin.bench.camera import (
    CAMERA,
    HFOV_DEG,
    SUN,
    VEHICLE,
    CameraBench,
    Size,
    best_rate,
    eyes,
    views,
)
from twin.bench.lambert import LambertCamera, Way
from twin.render.build import CUDA, KernelOptions, Tuning, tuning_for
from twin.render.picture import PARTS
from twin.render.trace.bvh import BvhWidth
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.scene import load_scene
from twin.world.street.build import World, build_world

WAYS: dict[str, Way] = {
    "warp leaf 2": Way(traversal="warp", leaf=2, registers=0),
    "warp leaf 2 block 64": Way(traversal="warp", leaf=2, block=64, registers=0),
    "own": Way(),
    "own leaf 1": Way(shape=BvhWidth(4, 1, packed=False)),
    "own leaf 4": Way(shape=BvhWidth(4, 4, packed=False)),
    "own leaf 8": Way(shape=BvhWidth(4, 8, packed=False)),
    "own block 64": Way(block=64, registers=16),
    "own block 256": Way(block=256, registers=4),
    "own 6 blocks of 128": Way(block=128, registers=6),
    "own free registers": Way(registers=0),
    "own 10 blocks of 128": Way(block=128, registers=10),
    "own tile 4x8": Way(tile=(4, 8)),
    "own tile 16x2": Way(tile=(16, 2)),
    "own tile 16x8": Way(tile=(16, 8)),
}
"""What is tried on a GPU; on a CPU the hierarchies' shape is fixed by the vector code."""
TUNINGS: dict[str, Tuning] = {
    "usual": CUDA,
    **{
        f"picture {blocks} blocks": replace(CUDA, picture=KernelOptions(blocks=blocks))
        for blocks in (0, 5, 6, 8)
    },
    "picture block 256": replace(CUDA, picture=KernelOptions(block=256, blocks=2)),
    "second rays in one kernel": replace(CUDA, hits=None),
    **{
        f"hits of second rays {blocks} blocks": replace(CUDA, hits=KernelOptions(blocks=blocks))
        for blocks in (0, 5, 7, 8)
    },
    **{
        f"light of second rays {blocks} blocks": replace(CUDA, light=KernelOptions(blocks=blocks))
        for blocks in (4, 6)
    },
    **{
        f"visibility {blocks} blocks": replace(CUDA, visibility=KernelOptions(blocks=blocks))
        for blocks in (0, 6, 7, 10)
    },
    "visibility block 64": replace(CUDA, visibility=KernelOptions(block=64, blocks=16)),
    "visibility block 256": replace(CUDA, visibility=KernelOptions(block=256, blocks=4)),
}
"""Ways to compile the kernels of the fast picture on a GPU."""
CPU_WAYS: dict[str, Way] = {
    "warp leaf 8": Way(traversal="warp", leaf=8),
    "own": Way(),
    "own scalar": Way(traversal="scalar", shape=BvhWidth(4, 2, packed=False)),
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
    if not wp.get_device(device).is_cpu:
        table["mirrors picture"] = {
            name: _fast(world, size, device, tuning, rounds) for name, tuning in TUNINGS.items()
        }
    return table


def _fast(world: World, size: Size, device: str, tuning: Tuning, rounds: int) -> object:
    try:
        camera = CameraBench(world, size, device, "mirrors", tuning)
        rate = best_rate(camera.launch, wp.get_device(device), rounds) * size.slots
        kernels = camera.kernel_ms()
    except Exception as error:  # as above
        return str(error)
    return {"frames_per_s": round(rate, 1), "kernels_ms": kernels}


_ROWS: dict[str, dict[str, float]] = {
    "no shadows": {"shadows": 0},
    "no night lamps": {"lamps_on": 0, "low_beam": 0, "high_beam": 0, "fog_lamp": 0},
    "no precipitation": {"rain": 0, "snow": 0},
    "dry": {"wetness": 0},
    "no fog": {"extinction": 0},
}
"""Values of every view's light that switch something off."""
_VIEWS: dict[str, tuple[str, int]] = {
    "clear noon": ("clear", 720),
    "heavy rain at night": ("heavy_rain", 1320),
    "heavy fog at night": ("heavy_fog", 1320),
}


def ablate(device: str, size: Size) -> dict[str, object]:
    """Time of every kernel [ms], and of pictures with second rays with parts left out."""
    world = build_world(load_scene("downtown"))
    still = replace(world, kinds=(), motion=Still(), mover_classes=())
    usual = tuning_for(wp.get_device(device))
    table: dict[str, object] = {"device": device, "size": dataclasses.asdict(size)}
    table["fast"] = CameraBench(world, size, device, "fast").kernel_ms()
    bench = CameraBench(world, size, device, "mirrors")
    table["mirrors"] = bench.kernel_ms()
    table["rays per pixel"] = bench.camera.rays_per_frame() / (size.width * size.height)
    for name, values in _ROWS.items():
        bench.light()
        for field, value in values.items():
            bench.camera.lights.host[field] = value
        table[name] = bench.kernel_ms()
    for name, (weather, minute) in _VIEWS.items():
        bench.light(weather, minute)
        table[name] = bench.kernel_ms()
    table["no objects"] = CameraBench(still, size, device, "fast").kernel_ms()
    for part in PARTS:
        tuning = replace(usual, without=frozenset({part}))
        table[f"no {part}"] = CameraBench(world, size, device, "fast", tuning).kernel_ms()
    tuning = replace(usual, without=frozenset(PARTS))
    table["none of these"] = CameraBench(world, size, device, "fast", tuning).kernel_ms()
    table["full"] = CameraBench(world, size, device, "full").kernel_ms()
    return table
