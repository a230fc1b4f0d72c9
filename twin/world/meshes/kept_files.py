"""Meshes and heightmaps of scenes, parsed once per content and kept beside the compiled kernels."""

from __future__ import annotations

from pathlib import Path

import msgspec

from schemas.files.assets import file_digest, mesh_files
from twin.world.kept import kept
from twin.world.meshes.apart import SceneFiles, read_files
from twin.world.scene import Scene

ENTRIES_MAX = 4
"""Most scenes whose files are kept: an entry may take a gigabyte."""


def kept_files(scene: Scene) -> SceneFiles:
    """:func:`twin.world.meshes.apart.read_files`, from the disk if these contents were read before.

    Raises:
        ValueError: as there; also if a file changes meanwhile.
        InfrastructureError: as there.
    """
    key = _contents(scene)
    if key is None:
        return read_files(scene)

    def read() -> SceneFiles:
        found = read_files(scene)
        if _contents(scene) != key:
            raise ValueError("meshes: a file changed while it was read; run the same command again")
        return found

    return kept("meshes", key, read, ENTRIES_MAX)


def _contents(scene: Scene) -> bytes | None:
    """What decides what the files of a scene hold; None: there are none, or one cannot be read."""
    meshes = [Path(item.file) for item in scene.meshes]
    heightmaps = [] if scene.terrain is None else [Path(scene.terrain.heightmap)]
    if not meshes and not heightmaps:
        return None
    try:
        rows = [[(path.name, file_digest(path))] for path in heightmaps]
        rows += [_rows(path) for path in meshes]
    except (OSError, ValueError):
        return None
    return msgspec.json.encode([len(heightmaps), rows])


def _rows(mesh: Path) -> list[tuple[str, str]]:
    """Name and digest of a mesh file and of what it names."""
    named = [(str(file), file) for file in mesh_files(mesh)[1:] if file.is_file()]
    short = [(name.removeprefix(f"{mesh.parent}/"), file_digest(file)) for name, file in named]
    return [(mesh.name, file_digest(mesh)), *short]
