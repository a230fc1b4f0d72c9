"""What materials from files cost a camera: the street with a yard of them before every view.

``PYTHONPATH=tests python tests/looks_bench.py [fast|mirrors|full ...] [--device cuda:0]
[--views COUNT --yards COUNT] [--check | --kernels] [--blocks KERNEL=COUNT ...]``. The kinds of
pictures and the views are those of ``twin bench camera``, once in its lights in turn and once at
noon, when no lamps are on and pictures take least. All worlds take turns, and the best of many
rounds counts, on a CPU in time of the process. Pictures of the materials are compared with two
others of the same faces, both of kernels without the code of materials:

- ``bare``: one colour each. Nothing in the yard is polished, so the materials also pay for the
  second rays of polished metal, which any polished surface asks for.
- ``lacquer``: one colour each, and the polished half of the metal wall is lacquer, a mirror that
  needs no material from a file. The same pixels ask for second rays: what differs is the cost of
  the features, that is holes, smooth normals, vertex colours, normal, roughness and emissive maps.
  ``--check`` exits with 1 where it is more than 10 %.

``--kernels`` prints the time of every kernel on a GPU instead, in the lights of the bench: of
lacquer, of the materials, and of the materials without normal maps (``level``), by which mirrored
rays stay together as those of lacquer do. ``--blocks look=7 light_detailed=5`` compiles kernels
of a GPU for other numbers of blocks on a multiprocessor than
:data:`twin.render.build.CUDA` says.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import warp as wp
from golden.looks_scene import write_yard

from twin.bench.camera import PICTURES, SCENE, CameraBench, Size, views
from twin.render.build import Tuning, tuning_for
from twin.world.content import MeshFile
from twin.world.kernel_cache import prepare_kernels
from twin.world.meshes.details import NORMAL
from twin.world.meshes.materials import CAR_PAINT
from twin.world.scene import load_scene
from twin.world.street.build import World, build_world

SIZES = {"cpu": Size(4, 320, 180), "cuda": Size(16, 640, 360)}
"""Views, without ``--views``, and a yard before each. 256 views of 10 yards, spread along the same
street, have as many pixels of materials as 16 of 16."""
PICTURES_TIMED = 320
"""Pictures between two looks at the clock, on a GPU."""
LIGHTS = {"all weathers, from dawn on": -1, "noon in all weathers": 12 * 60}
"""Minute of the day; -1: that of the camera bench."""
BARE, LACQUER, MATERIALS, LEVEL = "bare", "lacquer", "materials", "level"
LIMIT_PERCENT = 10.0
"""What the features may cost."""


def worlds(yards: int) -> dict[str, World]:
    """The same faces: bare, bare with a mirror of lacquer, and as the files say."""
    street = load_scene(SCENE)
    with tempfile.TemporaryDirectory() as folder:
        write_yard(Path(folder), wall_parts=2)
        file = str(Path(folder) / "yard.glb")
        meshes = [
            MeshFile(file=file, up="z", semantic="wall", position_m=[float(x) - 1.0, 0.0, 0.0])
            for x in views(build_world(street), yards).x_m
        ]
        full = build_world(msgspec.structs.replace(street, meshes=meshes))
    bare = replace(
        full, masks=(), looks=(), texture_kinds=(), mesh=replace(full.mesh, details=None)
    )
    material = np.where(polished(full), CAR_PAINT, bare.mesh.material)
    mesh = replace(bare.mesh, material=material.astype(bare.mesh.material.dtype))
    return {BARE: bare, LACQUER: replace(bare, mesh=mesh), MATERIALS: full}


def polished(world: World) -> np.ndarray:
    """Faces of the upper half of the metal wall, bool [F]."""
    details, mesh = world.mesh.details, world.mesh
    assert details is not None
    (metal,) = [number for number, look in enumerate(world.looks) if look.mirrors]
    wall = (details.row >= 0) & (details.look[details.row] == metal)
    middle_m = mesh.points_m[mesh.faces].mean(axis=1)[:, 2]
    return wall & (middle_m > middle_m[wall].mean())


def without_normal_maps(world: World) -> World:
    """The same faces and kernels, no bumps."""
    looks = []
    for look in world.looks:
        maps = list(look.maps)
        maps[NORMAL] = -1
        looks.append(replace(look, maps=tuple(maps)))
    return replace(world, looks=tuple(looks))


def kernel_times(bench: CameraBench) -> dict[str, float]:
    """Time of every kernel of one picture of all views on a GPU [ms], in their order; of several
    with one name the second has a 2 behind it."""
    wp.synchronize_device(bench.device)
    wp.timing_begin(cuda_filter=wp.TIMING_KERNEL)
    bench.launch()
    times: dict[str, float] = {}
    for result in wp.timing_end():
        name = kernel = result.name.removeprefix("forward kernel ").partition("_kernel")[0]
        while name in times:
            name = f"{kernel} {int(name.removeprefix(kernel) or 1) + 1}"
        times[name] = result.elapsed
    return times


def compare_kernels(benches: dict[str, CameraBench], rounds: int) -> None:
    """Print the least time of every kernel in each world [ms], and what the materials add to it in
    percent of a whole picture of lacquer."""
    least: dict[str, dict[str, float]] = {name: {} for name in benches}
    for bench in benches.values():
        bench.launch()
    for _ in range(rounds):
        for name, bench in benches.items():
            for kernel, ms in kernel_times(bench).items():
                least[name][kernel] = min(ms, least[name].get(kernel, math.inf))
    whole = sum(least[LACQUER].values())
    kernels = dict.fromkeys(kernel for times in least.values() for kernel in times)
    print("".join(f"{word:>12}" for word in ("kernel", *benches, "more", "%")))
    for kernel in (*kernels, "all"):
        row = {
            name: sum(times.values()) if kernel == "all" else times.get(kernel, 0.0)
            for name, times in least.items()
        }
        more = row[MATERIALS] - row[LACQUER]
        cells = "".join(f"{ms:12.3f}" for ms in (*row.values(), more))
        print(f"{kernel:>12}{cells}{100.0 * more / whole:12.1f}", flush=True)
    for name, bench in benches.items():
        print(f"  {name}: {bench.second_pixels():,} second rays {bench.camera.second_kinds()}")


def seconds(bench: CameraBench) -> float:
    """Time of a picture of all views: on a GPU by the clock, on a CPU that of the process [s]."""
    if bench.device.is_cpu:
        started = time.process_time()
        bench.launch()
        return time.process_time() - started
    launches = max(PICTURES_TIMED // bench.camera.shape[0], 2)
    wp.synchronize_device(bench.device)
    started = time.perf_counter()
    for _ in range(launches):
        bench.launch()
    wp.synchronize_device(bench.device)
    return (time.perf_counter() - started) / launches


def compare(benches: dict[str, CameraBench], rounds: int) -> float:
    """Print frames per second of each world, and how much slower the materials are than the others;
    the figure beside equal second rays [%]."""
    least = dict.fromkeys(benches, math.inf)
    for bench in benches.values():
        bench.launch()
    for _ in range(rounds):
        for name, bench in benches.items():
            least[name] = min(least[name], seconds(bench))
    for name, bench in benches.items():
        row = f"    {name}: {bench.camera.shape[0] / least[name]:,.1f} frames/s"
        print(f"{row}, {bench.second_pixels():,} pixels listed for second rays")
        if not bench.device.is_cpu:
            print(f"      {bench.kernel_ms()}")
    bare, lacquer = (100.0 * (1.0 - least[n] / least[MATERIALS]) for n in (BARE, LACQUER))
    print(f"    slower than bare ones {bare:.1f} %, with equal second rays {lacquer:.1f} %")
    sys.stdout.flush()
    return lacquer


def compiled(picture: str, device: str, tuning: Tuning) -> None:
    """Compile the kernels of one kind of picture for a GPU, and leave them in the cache."""
    prepare_kernels()
    for world in worlds(SIZES["cuda"].slots).values():
        CameraBench(world, SIZES["cuda"], device, picture, tuning)


def compile_together(pictures: list[str], device: str, tuning: Tuning) -> None:
    """Compile for a GPU, each kind of picture in a process: a compiler uses one core for long."""
    context = multiprocessing.get_context("spawn")
    jobs = [
        context.Process(target=compiled, args=(picture, device, tuning)) for picture in pictures
    ]
    for job in jobs:
        job.start()
    for job in jobs:
        job.join()


def tuned(device: str, blocks: list[str]) -> Tuning:
    """The usual compile options of a device, with other numbers of blocks: ``KERNEL=COUNT``."""
    tuning = tuning_for(wp.get_device(device))
    for word in blocks:
        kernel, _, count = word.partition("=")
        options = replace(getattr(tuning, kernel), blocks=int(count))
        tuning = replace(tuning, **{kernel: options})
    return tuning


def read_arguments() -> argparse.Namespace:
    """What was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("pictures", nargs="*", default=list(PICTURES), metavar="PICTURE")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--views", type=int, metavar="COUNT")
    parser.add_argument("--yards", type=int, metavar="COUNT")
    parser.add_argument("--rounds", type=int, default=40)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--kernels", action="store_true")
    parser.add_argument("--blocks", nargs="*", default=[], metavar="KERNEL=COUNT")
    arguments = parser.parse_args()
    if arguments.device == "cpu" and (arguments.kernels or arguments.blocks):
        parser.error("--kernels and --blocks are for a GPU: --device cuda:0")
    return arguments


def main() -> int:
    """Compare on one device; 1: the features cost too much."""
    arguments = read_arguments()
    kind = arguments.device.partition(":")[0]
    usual = SIZES[kind]
    size = replace(usual, slots=arguments.views or usual.slots)
    yards = arguments.yards or usual.slots
    tuning = tuned(arguments.device, arguments.blocks)
    if kind == "cuda":
        compile_together(arguments.pictures, arguments.device, tuning)
    prepare_kernels()
    chosen = worlds(yards)
    if arguments.kernels:
        chosen = {name: chosen[name] for name in (LACQUER, MATERIALS)}
        chosen[LEVEL] = without_normal_maps(chosen[MATERIALS])
    most = 0.0
    for picture in arguments.pictures:
        benches = {
            name: CameraBench(world, size, arguments.device, picture, tuning)
            for name, world in chosen.items()
        }
        if arguments.kernels:
            print(picture)
            compare_kernels(benches, arguments.rounds)
            continue
        images = {name: benches[name].render().astype(int) for name in (BARE, MATERIALS)}
        apart = np.abs(images[MATERIALS] - images[BARE]).max(axis=-1) > 2
        print(f"{picture}: {100 * apart.mean():.0f} % of pixels differ from bare ones", flush=True)
        for words, minute in LIGHTS.items():
            print(f"  {words}", flush=True)
            for bench in benches.values():
                bench.light(minute_of_day=minute)
            most = max(most, compare(benches, arguments.rounds))
    if arguments.check and most > LIMIT_PERCENT:
        print(f"{most:.1f} % slower with equal second rays, at most {LIMIT_PERCENT:.0f} % wanted")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
