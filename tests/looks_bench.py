"""What materials from files cost a camera: the street with a yard of them before every view.

``PYTHONPATH=tests python tests/looks_bench.py [fast|mirrors|full ...] [--device cuda:0]``. The
kinds of pictures and the views are those of ``twin bench camera``, once in its lights in turn and
once at noon, when no lamps are on and pictures take least. All worlds take turns, and the best of
many rounds counts, on a CPU in time of the process. Two comparisons are printed, on a GPU the first
alone, and each row says with what it is compared:

- With the same faces bare: one colour each, kernels without the code of materials. The bare
  scene has no polished metal, so this row includes the second rays of the metal. The limit of 10 %
  is meant here.
- With equal second rays: the whole metal wall is polished. Once maps say so, once two numbers of
  the material do, and once the faces are lacquer, a plain material with a mirror. What differs is
  the cost of maps, and of the code of materials.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import warp as wp
from golden.looks_scene import write_yard

from twin.bench.camera import PICTURES, SCENE, CameraBench, Size, views
from twin.world.content import MeshFile
from twin.world.kernel_cache import prepare_kernels
from twin.world.meshes.details import SHINE
from twin.world.meshes.materials import CAR_PAINT
from twin.world.scene import load_scene
from twin.world.street.build import World, build_world

SIZES = {"cpu": Size(4, 320, 180), "cuda": Size(16, 640, 360)}
LAUNCHES = 20
"""Pictures of all views between two looks at the clock, on a GPU."""
LIGHTS = {"all weathers, from dawn on": -1, "noon in all weathers": 12 * 60}
"""Minute of the day; -1: that of the camera bench."""


BARE, DULL, FULL = "bare", "materials, no rays of metal", "materials"
LACQUER, NUMBERS, MAPS = "wall of lacquer, no materials", "wall polished by numbers", "... by maps"
COMPARED = {DULL: (BARE,), FULL: (BARE,), NUMBERS: (LACQUER,), MAPS: (LACQUER, NUMBERS)}
"""Rows that are printed, each with what it is compared with."""
ON_GPU = (BARE, DULL, FULL)
"""What is compared on a GPU."""
POLISHED = (0, 26, 255)
"""A texel that says: metal, of roughness 0.1."""


def worlds(size: Size) -> dict[str, World]:
    """The same faces: bare, as the files say but without mirrors that are worth a ray, as they say;
    and the wall as a mirror, of lacquer, by factors, by maps."""
    street = load_scene(SCENE)
    with tempfile.TemporaryDirectory() as folder:
        write_yard(Path(folder))
        file = str(Path(folder) / "yard.glb")
        meshes = [
            MeshFile(file=file, up="z", semantic="wall", position_m=[float(x) - 1.0, 0.0, 0.0])
            for x in views(build_world(street), size.slots).x_m
        ]
        full = build_world(msgspec.structs.replace(street, meshes=meshes))
    dull = replace(full, looks=tuple(replace(look, mirrors=False) for look in full.looks))
    return {BARE: without_looks(full), DULL: dull, FULL: full} | polished(full)


def without_looks(world: World) -> World:
    """The same faces without what files say of their materials."""
    mesh = replace(world.mesh, details=None)
    return replace(world, masks=(), looks=(), texture_kinds=(), mesh=mesh)


def polished(world: World) -> dict[str, World]:
    """Three worlds whose metal wall mirrors at every point."""
    (metal,) = [number for number, look in enumerate(world.looks) if look.mirrors]
    look = world.looks[metal]
    textures = list(world.textures)
    textures[look.maps[SHINE]] = np.full((2, 1, 3), POLISHED, np.uint8)
    numbers = replace(look, metallic=1.0, roughness=POLISHED[1] / 255.0, maps=(-1, -1, -1))
    looks = (*world.looks[:metal], numbers, *world.looks[metal + 1 :])
    details = world.mesh.details
    assert details is not None
    wall = (details.row >= 0) & (details.look[details.row] == metal)
    bare = without_looks(world)
    material = np.where(wall, CAR_PAINT, bare.mesh.material).astype(bare.mesh.material.dtype)
    return {
        LACQUER: replace(bare, mesh=replace(bare.mesh, material=material)),
        NUMBERS: replace(world, looks=looks),
        MAPS: replace(world, textures=textures),
    }


def seconds(bench: CameraBench) -> float:
    """Time of a picture of all views: on a GPU by the clock, on a CPU that of the process [s]."""
    if bench.device.is_cpu:
        started = time.process_time()
        bench.launch()
        return time.process_time() - started
    wp.synchronize_device(bench.device)
    started = time.perf_counter()
    for _ in range(LAUNCHES):
        bench.launch()
    wp.synchronize_device(bench.device)
    return (time.perf_counter() - started) / LAUNCHES


def compare(benches: dict[str, CameraBench], rounds: int) -> None:
    """Print frames per second of each, and how much slower it is than what it is compared with."""
    least = dict.fromkeys(benches, math.inf)
    for bench in benches.values():
        bench.launch()
    for _ in range(rounds):
        for name, bench in benches.items():
            least[name] = min(least[name], seconds(bench))
    for name, bench in benches.items():
        row = f"    {name}: {bench.camera.shape[0] / least[name]:,.1f} frames/s"
        row += f", {bench.second_pixels():,} pixels listed for second rays"
        for other in COMPARED.get(name, ()):
            if other in least:
                row += f", {100.0 * (1.0 - least[other] / least[name]):.1f} % slower than '{other}'"
        print(row, flush=True)
        if not bench.device.is_cpu:
            print(f"      {bench.kernel_ms()}", flush=True)


def compiled(picture: str, device: str) -> None:
    """Compile the kernels of one kind of picture for a GPU, and leave them in the cache."""
    prepare_kernels()
    chosen = worlds(SIZES["cuda"])
    for name in ON_GPU:
        CameraBench(chosen[name], SIZES["cuda"], device, picture)


def main() -> None:
    """Compare on one device."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("pictures", nargs="*", default=list(PICTURES), metavar="PICTURE")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--rounds", type=int, default=40)
    arguments = parser.parse_args()
    kind = arguments.device.partition(":")[0]
    size = SIZES[kind]
    if kind == "cuda":  # a compiler uses one core for long
        context = multiprocessing.get_context("spawn")
        jobs = [
            context.Process(target=compiled, args=(picture, arguments.device))
            for picture in arguments.pictures
        ]
        for job in jobs:
            job.start()
        for job in jobs:
            job.join()
    prepare_kernels()
    chosen = worlds(size)
    if kind == "cuda":
        chosen = {name: chosen[name] for name in ON_GPU}
    for picture in arguments.pictures:
        benches = {
            name: CameraBench(world, size, arguments.device, picture)
            for name, world in chosen.items()
        }
        images = {name: benches[name].render().astype(int) for name in (BARE, FULL)}
        apart = np.abs(images[FULL] - images[BARE]).max(axis=-1) > 2
        print(f"{picture}: {100 * apart.mean():.0f} % of pixels differ from bare ones", flush=True)
        for words, minute in LIGHTS.items():
            print(f"  {words}", flush=True)
            for bench in benches.values():
                bench.light(minute_of_day=minute)
            compare(benches, arguments.rounds)


if __name__ == "__main__":
    main()
