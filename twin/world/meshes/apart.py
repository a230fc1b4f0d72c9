"""Mesh files and heightmaps of a scene, read by a process apart (:mod:`twin.world.apart`)."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schemas.files.assets import mesh_files
from twin.world.apart.checks import Array, ListOf, Number, Record, Text
from twin.world.apart.parser import Parser
from twin.world.apart.reading import AskedFile, read_apart, unprotected
from twin.world.meshes.details import MAPS
from twin.world.meshes.mesh_file import MeshData, check_before
from twin.world.meshes.mesh_header import FACES_MAX
from twin.world.meshes.part import CUTOFF_MAX, Part
from twin.world.meshes.part_images import TEXTURE_SIDE_MAX
from twin.world.meshes.terrain import SAMPLES_MAX, check_heightmap
from twin.world.scene import Scene

PARTS_MAX, NOTES_MAX = 100_000, 10_000
"""Most parts and most notes of a mesh file."""

_PICTURE = Array("uint8", ("h", "w", 3), optional=True, side_min=1, side_max=TEXTURE_SIDE_MAX)
_ALPHA = Array("uint8", ("h", "w"), optional=True, side_min=1, side_max=TEXTURE_SIDE_MAX)
_WRAP = ListOf(Number(0, 2, whole=True), 2, least=2)
_SHARE = Number(0.0, 1.0)
PART = Record(
    Part,
    {
        "points": Array("float64", ("V", 3)),
        "faces": Array("int64", ("F", 3), below="V"),
        "color": Array("float64", ("F", 3)),
        "uv": Array("float64", ("V", 2), optional=True),
        "image": _PICTURE,
        "wrap": _WRAP,
        "colors": Array("float64", ("V", 3), optional=True),
        "normals": Array("float64", ("V", 3), optional=True),
        "tangents": Array("float64", ("V", 4), optional=True),
        "alpha": _ALPHA,
        "cutoff": Number(0.0, CUTOFF_MAX),
        "emission": ListOf(Number(0.0), 3, least=3),
        "metallic": _SHARE,
        "roughness": _SHARE,
        "normal_scale": Number(),
        "maps": ListOf(_PICTURE, MAPS, least=MAPS),
        "map_wraps": ListOf(_WRAP, MAPS, least=MAPS),
        "map_from_uv": Array("float64", (MAPS, 2, 3)),
    },
)
MESH_DATA = Record(
    MeshData, {"parts": ListOf(PART, PARTS_MAX, least=1), "notes": ListOf(Text(), NOTES_MAX)}
)
"""What may be answered of a mesh; a new field of :class:`Part` or :class:`MeshData` is a row."""

MESH = Parser("twin.world.meshes.mesh_file:load_mesh", MESH_DATA, "cannot be read as a mesh")
HEIGHTS = Parser(
    "twin.world.meshes.terrain:read_samples",
    Array("float64", ("r", "c"), side_min=2, side_max=SAMPLES_MAX),
    "cannot be read as a heightmap",
)
_MESH, _HEIGHTS = f"{__name__}:MESH", f"{__name__}:HEIGHTS"


@dataclass(frozen=True, slots=True)
class SceneFiles:
    """What the files of a scene hold."""

    samples: np.ndarray | None
    """Of the heightmap, as :func:`twin.world.meshes.terrain.read_samples` gives them; None: there
    is no terrain."""
    meshes: tuple[MeshData, ...]
    """One per entry of ``meshes``; files that stand there more than once are the same object."""
    notes: tuple[str, ...] = ()
    """How they were read, if that is worth a line."""


def read_mesh(path: Path) -> MeshData:
    """:func:`twin.world.meshes.mesh_file.load_mesh` in a process apart.

    Raises:
        ValueError: as there.
        InfrastructureError: the process did not start.
    """
    check_before(path)
    with closing(read_apart([_mesh(path)])) as answers:
        return _counted(next(answers), path)


def read_files(scene: Scene) -> SceneFiles:
    """All files of a scene, read by one process.

    Raises:
        ValueError: one cannot be used; one line that names it and its place in the scene file.
        InfrastructureError: the process did not start.
    """
    terrain = scene.terrain
    first = [] if terrain is None else [Path(terrain.heightmap)]
    for path in first:
        check_heightmap(path)
    numbers: dict[str, int] = {}
    for number, item in enumerate(scene.meshes):
        if item.file not in numbers:
            with _of_mesh(number):
                check_before(Path(item.file))
            numbers[item.file] = number
    asks = [AskedFile(_HEIGHTS, path) for path in first] + [_mesh(Path(name)) for name in numbers]
    notes = (words,) if asks and (words := unprotected()) else ()
    with closing(read_apart(asks)) as answers:
        samples = next(answers) if first else None
        meshes = {}
        for name, number in numbers.items():
            with _of_mesh(number):
                meshes[name] = _counted(next(answers), Path(name))
    return SceneFiles(samples, tuple(meshes[item.file] for item in scene.meshes), notes)


@contextmanager
def _of_mesh(number: int) -> Iterator[None]:
    """Names the mesh of a scene file in a refusal."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"meshes[{number}]: {error}") from None


def _mesh(path: Path) -> AskedFile:
    named = mesh_files(path)[1:]
    return AskedFile(_MESH, path, [file for file in map(_whole, named) if file.is_file()])


def _whole(path: Path) -> Path:
    return Path(os.path.realpath(path.parent)) / path.name


def _counted(data: MeshData, path: Path) -> MeshData:
    """Refuse what no reader of ours answers: no faces, or too many."""
    faces = sum(len(part.faces) for part in data.parts)
    if not 0 < faces <= FACES_MAX:
        raise ValueError(f"{path}: {MESH.failed}: its reader answered {faces} faces")
    return data
