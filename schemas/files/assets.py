"""Scene and vehicle files given by path: which files they consist of, and their digest.

A campaign names them by path, so the path alone says nothing of their content. At submission the
digest of each goes into the campaign and from there into its cases; a simulator that finds other
content refuses the case.
"""

from __future__ import annotations

import hashlib
import html
import json
import os
import re
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from schemas.files.named_files import as_text, file_names
from schemas.files.regular_file import open_regular, read_regular
from schemas.files.yaml_file import load_yaml

FILE_BYTES_MAX = 2 << 30
"""Largest scene, vehicle, mesh or model file [bytes]."""

ROAD_SUFFIX = ".xodr"
"""How names of OpenDRIVE files end."""
SCENARIO_SUFFIX = ".xosc"
"""How names of OpenSCENARIO XML files end."""
_SUFFIXES = (".yaml", ".yml", ROAD_SUFFIX, SCENARIO_SUFFIX)
"""How names end that are paths of files."""

_FILE_KEYS = ("file", "heightmap", "opendrive")
"""Keys of scene and vehicle files whose values are paths, relative to the file."""
_NAME_KEYS = ("profile", "road")
"""Keys whose values are names, or such paths."""

# To the end of a line, whatever it holds: a pattern that looks for the last word of it can be made
# to take hours.
_MAP = re.compile(
    rb"^[ \t]*(?:map_\w+|bump|disp|decal|norm|refl)[ \t]+([^\r\n]+)", re.MULTILINE | re.IGNORECASE
)
_LIBRARY = re.compile(rb"[ \t]*mtllib[ \t]+([^\r\n]+)")
_PLY_TEXTURE = re.compile(
    rb"^comment[ \t]+TextureFile[ \t]+([^\r\n]+)", re.MULTILINE | re.IGNORECASE
)
_ROADS = re.compile(rb"""=\s*["']([^"'<>]{1,4096}\.xodr)\s*["']""")
"""Roads that an OpenSCENARIO file names, also as the value of a parameter."""
_CATALOGS = re.compile(rb"""<Directory\s[^<>]*?path\s*=\s*["']([^"'<>]{1,4096})["']""")
_HEAD_BYTES = 64 << 10
_LINE_BYTES_MAX = 64 << 10
_TEXT_BYTES_MAX = 64 << 20
"""Largest JSON of a glTF file, and largest material library, that is searched [bytes]."""


def is_path(name: str) -> bool:
    """Whether a scene's or vehicle's name is the path of a file."""
    return "/" in name or name.endswith(_SUFFIXES)


def asset_files(path: Path) -> list[Path]:
    """The file itself, the files it names, and the files that those name; each once. An OpenDRIVE
    file names none, an OpenSCENARIO file its road and the files of its catalogs.

    Files that do not exist are left out: whoever loads them says so.

    Raises:
        YamlError: not readable, or not YAML.
    """
    paths = [path]
    if path.suffix == SCENARIO_SUFFIX:
        return [file for file in dict.fromkeys([path, *_scenario_files(path)]) if file.is_file()]
    for name in () if path.suffix == ROAD_SUFFIX else _named_in(path):
        paths += mesh_files(path.parent / name)
    unique = dict.fromkeys(file for file in paths if file.is_file())
    return list(unique)


def asset_digest(path: Path) -> str:
    """SHA-256 over the contents of :func:`asset_files` and, but for the file itself, their names
    relative to its folder.

    Raises:
        YamlError: not readable, or not YAML.
        OSError: a file cannot be read.
    """
    sha = hashlib.sha256()
    for file in asset_files(path):
        name = os.path.relpath(file, path.parent) if file != path else ""
        sha.update(f"{name}\0{file_digest(file)}\n".encode())
    return sha.hexdigest()


def file_digest(path: Path, most: int | None = FILE_BYTES_MAX) -> str:
    """SHA-256 of a file's content, whatever it is called.

    Args:
        path: the file.
        most: its largest size [bytes]; None: any.

    Raises:
        OSError: it cannot be read, is larger or no regular file.
    """
    with open_regular(path, most) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _scenario_files(path: Path) -> list[Path]:
    """The roads that an OpenSCENARIO file names, and all files in the folders of its catalogs."""
    try:
        text = read_regular(path, _TEXT_BYTES_MAX)
    except (OSError, ValueError):
        return []  # whoever loads it says why
    roads = [path.parent / html.unescape(as_text(name)) for name in _ROADS.findall(text)]
    folders = [path.parent / html.unescape(as_text(name)) for name in _CATALOGS.findall(text)]
    catalogs = [
        file for folder in folders if folder.is_dir() for file in folder.glob(f"*{SCENARIO_SUFFIX}")
    ]
    return [*roads, *sorted(catalogs)]


def _named(value: Any) -> list[str]:
    """Values of the keys that name files, anywhere in the document, in order."""
    if isinstance(value, dict):
        files = [value[key] for key in _FILE_KEYS if isinstance(value.get(key), str)]
        names = [value[key] for key in _NAME_KEYS if isinstance(value.get(key), str)]
        files += [name for name in names if is_path(name)]
        return files + [name for inner in value.values() for name in _named(inner)]
    if isinstance(value, list):
        return [name for inner in value for name in _named(inner)]
    return []


NAMED_MAX = 1024
"""Most files of which a process keeps the names that they hold."""


class _ChangedError(Exception):
    """A file was written anew while it was read."""


def _named_in(path: Path) -> tuple[str, ...]:
    """:func:`_named` of a YAML file."""
    try:
        return _named_by_content(path, file_digest(path))
    except (OSError, _ChangedError):
        return tuple(_named(load_yaml(path)))  # which says why


@lru_cache(maxsize=NAMED_MAX)
def _named_by_content(path: Path, content: str) -> tuple[str, ...]:
    """Names in a file with this digest, read once: a check of a campaign with a hundred
    scenario files asks five times for the names in each."""
    names = tuple(_named(load_yaml(path)))
    if file_digest(path) != content:
        raise _ChangedError
    return names


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
        with open_regular(mesh) as file:
            head = file.read(_HEAD_BYTES).split(b"end_header")[0]
        return [name for given in _PLY_TEXTURE.findall(head) for name in file_names(as_text(given))]
    if suffix in (".gltf", ".glb"):
        return _gltf_resources(mesh)
    return _obj_resources(mesh) if suffix == ".obj" else []


def _obj_resources(mesh: Path) -> list[str]:
    names: list[str] = []
    with open_regular(mesh, FILE_BYTES_MAX) as lines:
        while line := lines.readline(_LINE_BYTES_MAX):
            if b"mtllib" in line and (library := _LIBRARY.match(line)):
                names += file_names(as_text(library[1]))
    for library_name in list(names):
        path = mesh.parent / library_name
        try:
            materials = read_regular(path, _TEXT_BYTES_MAX)
        except (OSError, ValueError):
            continue
        pictures = [
            picture
            for named in dict.fromkeys(_MAP.findall(materials))
            for picture in file_names(as_text(named))
        ]
        # They lie beside the mesh, or beside the library.
        folder = Path(library_name).parent
        names += [*pictures, *(str(folder / picture) for picture in pictures)]
    return names


def _gltf_resources(mesh: Path) -> list[str]:
    try:
        with open_regular(mesh) as file:
            head = file.read(20)
            if head[:4] == b"glTF":  # binary: a header, then a chunk of JSON
                data = file.read(min(int.from_bytes(head[12:16], "little"), _TEXT_BYTES_MAX))
            else:
                data = head + file.read(_TEXT_BYTES_MAX)
        document = json.loads(data)
    except (ValueError, RecursionError):
        return []
    rows = [*_rows(document, "buffers"), *_rows(document, "images")]
    uris = [row.get("uri") for row in rows if isinstance(row, dict)]
    return [unquote(uri) for uri in uris if isinstance(uri, str) and not uri.startswith("data:")]


def _rows(document: Any, key: str) -> list[Any]:
    rows = document.get(key) if isinstance(document, dict) else None
    return rows if isinstance(rows, list) else []
