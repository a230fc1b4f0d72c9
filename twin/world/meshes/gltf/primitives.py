"""Triangles of glTF primitives: lists, strips and fans, plain, indexed or Draco-compressed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from twin.world.meshes.gltf.accessors import array
from twin.world.meshes.gltf.document import DRACO, Document, GltfError

TRIANGLES, STRIP, FAN = 4, 5, 6
_NAMES = {0: "points", 1: "lines", 2: "line loops", 3: "line strips"}


@dataclass(slots=True)
class Primitive:
    """A primitive in the axes of its mesh."""

    points: np.ndarray
    """float64 [V, 3]"""
    faces: np.ndarray
    """int64 [F, 3]; not yet checked against the number of points."""
    attributes: dict[str, np.ndarray] = field(default_factory=dict)
    """The others that were asked for, float64 [V, n]."""


def read_primitive(
    document: Document, row: dict[str, Any], wanted: tuple[str, ...]
) -> Primitive | None:
    """One primitive with the attributes that are ``wanted``; None: it has no triangles, which is
    noted.

    Raises:
        GltfError: it cannot be read.
        OSError: a file cannot be read.
    """
    mode = row.get("mode", TRIANGLES)
    if mode not in (TRIANGLES, STRIP, FAN):
        document.note(f"{_NAMES.get(mode, 'primitives of an unknown mode')} left out")
        return None
    names = row.get("attributes")
    if not isinstance(names, dict) or "POSITION" not in names:
        document.note("a primitive without positions left out")
        return None
    extensions = row.get("extensions", {})
    packed = extensions.get(DRACO) if isinstance(extensions, dict) else None
    if isinstance(packed, dict):
        corners, found = _draco(document, packed, ("POSITION", *wanted))
    else:
        found = {
            name: array(document, names[name]) for name in ("POSITION", *wanted) if name in names
        }
        corners = (
            array(document, row["indices"], as_float=False)
            if "indices" in row
            else np.arange(len(found["POSITION"]))
        )
    if corners.ndim != 1:
        raise GltfError("indices are no scalars")
    points = found.pop("POSITION")
    if points.ndim != 2 or points.shape[1] != 3:
        raise GltfError("positions are not x, y, z each")
    for name, values in found.items():
        if len(values) != len(points):
            raise GltfError(f"{name} has {len(values)} values for {len(points)} positions")
    return Primitive(points, _faces(corners, mode), found)


def _faces(corners: np.ndarray, mode: int) -> np.ndarray:
    """Corners -> triangles [F, 3] (glTF 2.0, 3.7.2.1)."""
    if mode == TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    count = max(0, len(corners) - 2)
    i = np.arange(count)
    if mode == FAN:
        return np.stack([corners[i + 1], corners[i + 2], np.repeat(corners[:1], count)], axis=1)
    odd = i % 2
    return np.stack([corners[i], corners[i + 1 + odd], corners[i + 2 - odd]], axis=1)


def _draco(
    document: Document, packed: dict[str, Any], wanted: tuple[str, ...]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Indices and attributes of a Draco-compressed primitive."""
    try:
        import DracoPy
    except ModuleNotFoundError:
        raise GltfError(
            "it is compressed with Draco; install drivetwin[gltf], or export without"
        ) from None
    data, _ = document.view(packed.get("bufferView"))
    numbers = packed.get("attributes")
    try:
        mesh = DracoPy.decode(data)
        found = {
            name: np.asarray(mesh.get_attribute_by_unique_id(number)["data"], np.float64)
            for name, number in (numbers if isinstance(numbers, dict) else {}).items()
            if name in wanted
        }
        faces = np.asarray(mesh.faces, np.int64).reshape(-1)
    except Exception as error:  # the library raises what its C++ parts do
        raise GltfError(f"its Draco data cannot be read: {str(error)[:80]}") from None
    if "POSITION" not in found:
        raise GltfError("its Draco data has no positions")
    return faces, found
