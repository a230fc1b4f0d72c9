"""What materials from files cost a camera: the street with a yard of them before every view.

``PYTHONPATH=tests python tests/looks_bench.py [fast|mirrors|full ...]``. The kinds of pictures and
the views are those of ``twin bench camera``; all worlds take turns, and the best of many rounds
counts, in time of the process. Two comparisons are printed, and each row says with what it is
compared:

- With the same faces bare: one colour each, kernels without the code of materials. The bare
  scene has no polished metal, so this row includes the second rays of the metal. The limit of 10 %
  is meant here.
- With equal second rays: the whole metal wall is polished. Once maps say so, once two numbers of
  the material do, and once the faces are lacquer, a plain material with a mirror. What differs is
  the cost of maps, and of the code of materials.
"""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
from golden.looks_scene import write_yard

from twin.bench.camera import PICTURES, SCENE, CameraBench, Size, views
from twin.world.content import MeshFile
from twin.world.kernel_cache import prepare_kernels
from twin.world.meshes.details import SHINE
from twin.world.meshes.materials import CAR_PAINT
from twin.world.scene import load_scene
from twin.world.street.build import World, build_world

SIZE = Size(4, 320, 180)
ROUNDS = 40


BARE, DULL, FULL = "bare", "materials, no rays of metal", "materials"
LACQUER, NUMBERS, MAPS = "wall of lacquer, no materials", "wall polished by numbers", "... by maps"
COMPARED = {DULL: (BARE,), FULL: (BARE,), NUMBERS: (LACQUER,), MAPS: (LACQUER, NUMBERS)}
"""Rows that are printed, each with what it is compared with."""
POLISHED = (0, 26, 255)
"""A texel that says: metal, of roughness 0.1."""


def worlds() -> dict[str, World]:
    """The same faces: bare, as the files say but without mirrors that are worth a ray, as they say;
    and the wall as a mirror, of lacquer, by factors, by maps."""
    street = load_scene(SCENE)
    with tempfile.TemporaryDirectory() as folder:
        write_yard(Path(folder))
        file = str(Path(folder) / "yard.glb")
        meshes = [
            MeshFile(file=file, up="z", semantic="wall", position_m=[float(x) - 1.0, 0.0, 0.0])
            for x in views(build_world(street), SIZE.slots).x_m
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


def main(pictures: list[str]) -> None:
    """Print frames per second of each, and how much slower it is than what it is compared with."""
    prepare_kernels()
    compared = worlds()
    for picture in pictures:
        benches = {
            name: CameraBench(world, SIZE, "cpu", picture) for name, world in compared.items()
        }
        images = {name: bench.render().astype(int) for name, bench in benches.items()}
        best = dict.fromkeys(benches, 0.0)
        for _ in range(ROUNDS):
            for name, bench in benches.items():
                started = time.process_time()
                bench.launch()
                bench.launch()
                spent = time.process_time() - started
                best[name] = max(best[name], 2 * SIZE.slots / spent)
        apart = np.abs(images[FULL] - images[BARE]).max(axis=-1) > 2
        print(f"{picture}: {100 * apart.mean():.0f} % of pixels differ from bare ones", flush=True)
        for name, rate in best.items():
            rays = benches[name].second_pixels()
            row = f"  {name}: {rate:.1f} frames/s, {rays} pixels listed for second rays"
            for other in COMPARED.get(name, ()):
                row += f", {100.0 * (1.0 - rate / best[other]):.1f} % slower than '{other}'"
            print(row, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or list(PICTURES))
