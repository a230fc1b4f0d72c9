"""Textures of glTF materials: picture, coordinates, and what lies beyond its borders."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.world.meshes.details import CLAMP, MIRRORED, REPEAT
from twin.world.meshes.gltf.document import BASIS, TRANSFORM, WEBP, Document, GltfError

_WRAPS = {10497: REPEAT, 33071: CLAMP, 33648: MIRRORED}


@dataclass(frozen=True, slots=True)
class GltfMap:
    """A texture as a material uses it."""

    image: int
    """Number of its picture."""
    texcoord: str
    """Attribute with the picture's coordinates."""
    uv_from: np.ndarray
    """Coordinates in the picture from those of the attribute, float64 [2, 3]."""
    wrap: tuple[int, int]
    """What it does beyond its borders along u and v, as in :mod:`twin.world.meshes.details`."""


def map_of(document: Document, owner: dict[str, Any], key: str) -> GltfMap | None:
    """The texture under ``key`` of a material; None: it has none that can be shown.

    Raises:
        GltfError: it cannot be read.
    """
    info = owner.get(key)
    if not isinstance(info, dict):
        return None
    transform = object_of(object_of(info, "extensions"), TRANSFORM)
    texcoord = transform.get("texCoord", info.get("texCoord", 0))
    texture = document.row("textures", info.get("index"))
    image = _image(texture)
    if image is None:
        document.note("a texture without a picture that can be read ignored")
        return None
    return GltfMap(image, f"TEXCOORD_{texcoord}", _matrix(transform), _wrap(document, texture))


def map_from_map(there: GltfMap, here: GltfMap) -> np.ndarray | None:
    """Coordinates in ``there`` from those in ``here``, both with v up, float64 [2, 3]; None: they
    come from other attributes."""
    if there.texcoord != here.texcoord:
        return None
    if np.array_equal(there.uv_from, here.uv_from):
        return np.eye(2, 3)
    flip = np.array([(1.0, 0.0, 0.0), (0.0, -1.0, 1.0), (0.0, 0.0, 1.0)])
    below = (0.0, 0.0, 1.0)
    try:
        back = np.linalg.inv(np.vstack([here.uv_from, below]))
    except np.linalg.LinAlgError:
        return None
    return (flip @ np.vstack([there.uv_from, below]) @ back @ flip)[:2]


def _image(texture: dict[str, Any]) -> int | None:
    """Number of a texture's picture, in a format that is read."""
    extensions = object_of(texture, "extensions")
    number = object_of(extensions, WEBP).get("source", texture.get("source"))
    if number is None:  # a plain copy is the same whatever is installed
        number = object_of(extensions, BASIS).get("source")
    return number if isinstance(number, int) else None


def _wrap(document: Document, texture: dict[str, Any]) -> tuple[int, int]:
    if "sampler" not in texture:
        return REPEAT, REPEAT
    sampler = document.row("samplers", texture["sampler"])
    found = []
    for key in ("wrapS", "wrapT"):
        code = sampler.get(key, 10497)
        if not isinstance(code, int) or code not in _WRAPS:
            document.note("a sampler with an unknown wrap mode: its textures repeat")
            code = 10497
        found.append(_WRAPS[code])
    return found[0], found[1]


def _matrix(transform: dict[str, Any]) -> np.ndarray:
    """Matrix of KHR_texture_transform: scaled, turned anticlockwise as seen (v points down),
    moved."""
    scale = numbers_of(transform, "scale", (1, 1))
    offset = numbers_of(transform, "offset", (0, 0))
    (angle,) = numbers_of(transform, "rotation", (0,))
    c, s = math.cos(angle), math.sin(angle)
    return np.array(
        [[c * scale[0], s * scale[1], offset[0]], [-s * scale[0], c * scale[1], offset[1]]]
    )


def object_of(row: dict[str, Any], key: str) -> dict[str, Any]:
    """An object inside another one; empty: it is not there.

    Raises:
        GltfError: it is something else.
    """
    found = row.get(key, {})
    if not isinstance(found, dict):
        raise GltfError(f"'{key}' is no object")
    return found


def numbers_of(row: dict[str, Any], key: str, default: tuple[float, ...]) -> list[float]:
    """As many finite numbers as the default has.

    Raises:
        GltfError: it holds something else.
    """
    found = row.get(key, default)
    values = found if isinstance(found, list | tuple) else [found]
    good = len(values) == len(default) and all(
        isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        for value in values
    )
    if not good:
        raise GltfError(f"'{key}' is {str(found)[:40]}, needed {len(default)} numbers")
    return [float(value) for value in values]
