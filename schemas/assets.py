"""Scene and vehicle files given by path: which files they consist of, and their digest.

A campaign names them by path, so the path alone says nothing of their content. At submission the
digest of each goes into the campaign and from there into its cases; a simulator that finds other
content refuses the case.
"""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from schemas.yaml_file import load_yaml

_FILE_KEYS = ("file", "heightmap")
"""Keys of scene and vehicle files whose values are paths, relative to the file."""
_NAME_KEYS = ("profile",)
"""Keys whose values are names, or such paths."""

_MATERIAL_LIBRARY = re.compile(rb"^\s*mtllib\s+(.+?)\s*$", re.MULTILINE)
_MAP = re.compile(rb"^\s*(?:map_\w+|bump|disp|decal)\s+(.+?)\s*$", re.MULTILINE)
_PLY_TEXTURE = re.compile(rb"^comment\s+TextureFile\s+(.+?)\s*$", re.MULTILINE)
_HEAD_BYTES = 64 << 10
_TEXT_BYTES_MAX = 64 << 20
"""Largest glTF or OBJ file that is searched for the files it names [bytes]."""


def is_path(name: str) -> bool:
    """Whether a scene's or vehicle's name is the path of a file."""
    return "/" in name or name.endswith((".yaml", ".yml"))


def asset_files(path: Path) -> list[Path]:
    """The YAML file itself, the files it names, and the files that those name; each once.

    Files that do not exist are left out: whoever loads them says so.

    Raises:
        YamlError: not readable, or not YAML.
    """
    found = [path]
    for name in _named(load_yaml(path)):
        found += mesh_files(path.parent / name)
    unique = dict.fromkeys(file for file in found if file.is_file())
    return list(unique)


def asset_digest(path: Path) -> str:
    """SHA-256 over the names (relative to the file's folder) and contents of :func:`asset_files`.

    Raises:
        YamlError: not readable, or not YAML.
        OSError: a file cannot be read.
    """
    sha = hashlib.sha256()
    for file in asset_files(path):
        with file.open("rb") as stream:
            content = hashlib.file_digest(stream, "sha256").hexdigest()
        name = path.name if file == path else str(file)[len(str(path.parent)) :]
        sha.update(f"{name}\0{content}\n".encode())
    return sha.hexdigest()


def _named(value: Any) -> list[str]:
    """Values of the keys that name files, anywhere in the document, in order."""
    if isinstance(value, dict):
        own = [value[key] for key in _FILE_KEYS if isinstance(value.get(key), str)]
        names = [value[key] for key in _NAME_KEYS if isinstance(value.get(key), str)]
        own += [name for name in names if is_path(name)]
        return own + [name for inner in value.values() for name in _named(inner)]
    if isinstance(value, list):
        return [name for inner in value for name in _named(inner)]
    return []


def mesh_files(mesh: Path) -> list[Path]:
    """The mesh file and the local files that it names: buffers, material libraries, images.

    What cannot be read names nothing; loading the mesh says why.
    """
    return [mesh, *(mesh.parent / name for name in dict.fromkeys(_resources(mesh)))]


def _resources(mesh: Path) -> list[str]:
    if not mesh.is_file():
        return []
    suffix = mesh.suffix.lower()
    if suffix == ".ply":
        with mesh.open("rb") as file:
            head = file.read(_HEAD_BYTES).split(b"end_header")[0]
        return [name.decode(errors="replace") for name in _PLY_TEXTURE.findall(head)]
    if mesh.stat().st_size > _TEXT_BYTES_MAX or suffix not in (".gltf", ".obj"):
        return []
    if suffix == ".gltf":
        return _gltf_resources(mesh)
    found = []
    for library in _MATERIAL_LIBRARY.findall(mesh.read_bytes()):
        name = library.decode(errors="replace")
        found.append(name)
        if (mesh.parent / name).is_file():
            maps = _MAP.findall((mesh.parent / name).read_bytes())
            for line in maps:  # options may stand before the name; what is no file is left out
                text = line.decode(errors="replace")
                found += [text, text.split()[-1]]
    return found


def _gltf_resources(mesh: Path) -> list[str]:
    try:
        document = json.loads(mesh.read_bytes())
    except ValueError:
        return []
    rows = [*_rows(document, "buffers"), *_rows(document, "images")]
    uris = [row.get("uri") for row in rows if isinstance(row, dict)]
    return [unquote(uri) for uri in uris if isinstance(uri, str) and not uri.startswith("data:")]


def _rows(document: Any, key: str) -> list[Any]:
    rows = document.get(key) if isinstance(document, dict) else None
    return rows if isinstance(rows, list) else []
