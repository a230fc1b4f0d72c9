"""What a mesh file says about itself before it is loaded: how many faces.

A file of a hundred million triangles is refused by these few bytes, not by running out of memory.
"""

from __future__ import annotations

import json
import re
import struct
from pathlib import Path
from typing import Any

FACES_MAX = 5_000_000
"""Most triangles of one mesh file."""
FILE_BYTES_MAX = 1 << 30
"""Largest mesh file that is read [bytes]; formats without a count of faces are judged by it."""
SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl")

_HEAD_BYTES = 64 << 10
_GLTF_JSON_MAX = 64 << 20
_STL_HEAD, _STL_FACE = 84, 50
_TRIANGLES, _STRIP, _FAN = 4, 5, 6


def declared_faces(path: Path) -> int | None:
    """Faces that the file says it has; None: it does not say.

    Raises:
        ValueError: the head of the file is not of its format.
        OSError: it cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix == ".stl":
        return _stl_faces(path)
    if suffix == ".ply":
        return _ply_faces(path)
    if suffix in (".glb", ".gltf"):
        return _gltf_faces(gltf_json(path))
    return None


def _stl_faces(path: Path) -> int | None:
    with path.open("rb") as file:
        head = file.read(_STL_HEAD)
    size = path.stat().st_size
    if len(head) < _STL_HEAD:
        return None
    count = int(struct.unpack("<I", head[80:84])[0])
    if size == _STL_HEAD + count * _STL_FACE:
        return count
    if head[:5].lower() == b"solid":
        return None  # text
    if count > FACES_MAX:
        return count
    raise ValueError(f"its head says {count} faces, which is not what its {size} bytes hold")


def _ply_faces(path: Path) -> int | None:
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    end = head.find(b"end_header")
    if not head.startswith(b"ply") or end < 0:
        raise ValueError("no PLY header")
    found = re.search(rb"element\s+face\s+(\d+)", head[:end])
    return int(found.group(1)) if found else 0


def gltf_json(path: Path) -> dict[str, Any]:
    """The JSON part of a glTF or GLB file.

    Raises:
        ValueError: it is neither.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        if path.suffix.lower() == ".glb":
            head = file.read(20)
            if len(head) < 20 or head[:4] != b"glTF" or head[16:20] != b"JSON":
                raise ValueError("no GLB header")
            length = struct.unpack("<I", head[12:16])[0]
        else:
            length = path.stat().st_size
        if length > _GLTF_JSON_MAX:
            raise ValueError(f"{length} bytes of JSON, at most {_GLTF_JSON_MAX} are read")
        try:
            data = json.loads(file.read(length))
        except (ValueError, RecursionError):
            raise ValueError("its JSON cannot be read") from None
    if not isinstance(data, dict):
        raise ValueError("its JSON is no glTF document")
    return data


def _gltf_faces(data: dict[str, Any]) -> int:
    """Triangles of all primitives, each as often as nodes show its mesh."""
    try:
        shown = [node["mesh"] for node in data.get("nodes", ()) if "mesh" in node]
        accessors = data.get("accessors", [])
        total = 0
        for index, mesh in enumerate(data.get("meshes", ())):
            faces = 0
            for part in mesh["primitives"]:
                mode = part.get("mode", _TRIANGLES)
                if mode not in (_TRIANGLES, _STRIP, _FAN):
                    continue
                corners = part.get("indices", part["attributes"].get("POSITION"))
                count = int(accessors[corners]["count"])
                faces += count // 3 if mode == _TRIANGLES else max(0, count - 2)
            total += faces * max(1, shown.count(index))
    except (KeyError, TypeError, IndexError, ArithmeticError, ValueError, AttributeError):
        raise ValueError("its JSON is no glTF document") from None
    return total
