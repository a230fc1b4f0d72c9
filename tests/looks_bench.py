"""What materials from files cost a camera: the street with a yard of them before every view, with
and without what they say.

``PYTHONPATH=tests python tests/looks_bench.py [fast|mirrors|full ...]``. The kinds of pictures and
the views are those of ``twin bench camera``; both worlds take turns, and the best of many rounds
counts, in time of the process.
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
from twin.world.scene import load_scene
from twin.world.street.build import World, build_world

SIZE = Size(4, 320, 180)
ROUNDS = 40


def worlds() -> dict[str, World]:
    """The same faces: as the files say, without mirrors that are worth a ray, and bare."""
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
    mesh = replace(full.mesh, details=None)
    bare = replace(full, masks=(), looks=(), texture_kinds=(), mesh=mesh)
    return {"bare": bare, "materials, no rays of metal": dull, "materials": full}


def main(pictures: list[str]) -> None:
    """Print frames per second of each."""
    prepare_kernels()
    found = worlds()
    for picture in pictures:
        benches = {name: CameraBench(world, SIZE, "cpu", picture) for name, world in found.items()}
        images = {name: bench.render().astype(int) for name, bench in benches.items()}
        best = dict.fromkeys(benches, 0.0)
        for _ in range(ROUNDS):
            for name, bench in benches.items():
                started = time.process_time()
                bench.launch()
                bench.launch()
                spent = time.process_time() - started
                best[name] = max(best[name], 2 * SIZE.slots / spent)
        apart = np.abs(images["materials"] - images["bare"]).max(axis=-1) > 2
        print(f"{picture}: {100 * apart.mean():.0f} % of pixels differ", flush=True)
        for name, rate in best.items():
            loss = 100.0 * (1.0 - rate / best["bare"])
            print(f"  {name}: {rate:.1f} frames/s, {loss:.1f} % slower", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or list(PICTURES))
