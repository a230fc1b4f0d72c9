"""What cameras see of glTF materials: base colour, its texture, and what is left out."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image

from twin.world.meshes.gltf.document import BASIS, TRANSFORM, WEBP, Document, GltfError
from twin.world.meshes.gltf.ktx2 import is_ktx2, read_ktx2

REPEAT = 10497
GREY = 0.35
"""Linear reflectance of what has no material: the standard's white shines like nothing outdoors."""
IMAGE_PIXELS_MAX = 1 << 28
"""Largest picture that is decoded [px]."""


@dataclass(frozen=True, slots=True)
class GltfLook:
    """A material."""

    factor: np.ndarray
    """Linear RGB that the base colour is multiplied with, float64 [3]."""
    image: int | None
    """Number of its picture; None: it has none."""
    texcoord: str
    """Attribute with the picture's coordinates."""
    uv_from: np.ndarray
    """Coordinates in the picture from those of the attribute, float64 [2, 3]."""
    repeats: bool
    """Whether the picture repeats beyond its borders."""


def look_of(document: Document, index: object) -> GltfLook:
    """The material of this number; None: the default material. What is ignored is noted.

    Raises:
        GltfError: it cannot be read.
    """
    if index is None:
        return GltfLook(np.full(3, GREY), None, "", np.eye(2, 3), repeats=True)
    material = document.row("materials", index)
    metallic = _object(material, "pbrMetallicRoughness")
    factor = np.array(_numbers(metallic, "baseColorFactor", (1, 1, 1, 1))[:3])
    _note_ignored(document, material, metallic)
    info = metallic.get("baseColorTexture")
    if not isinstance(info, dict):
        return GltfLook(factor, None, "", np.eye(2, 3), repeats=True)
    transform = _object(_object(info, "extensions"), TRANSFORM)
    texcoord = transform.get("texCoord", info.get("texCoord", 0))
    texture = document.row("textures", info.get("index"))
    image = _image(texture)
    if image is None:
        document.note("a texture without a picture that can be read ignored")
    return GltfLook(
        factor,
        image,
        f"TEXCOORD_{texcoord}",
        _matrix(transform),
        repeats=_repeats(document, texture),
    )


def read_picture(document: Document, index: int) -> Image.Image:
    """A picture of the file.

    Raises:
        GltfError: it is not there, too large, or cannot be decoded.
        OSError: its file cannot be read.
    """
    row = document.row("images", index)
    data = document.view(row["bufferView"])[0] if "bufferView" in row else _file(document, row)
    try:
        if is_ktx2(data):
            return read_ktx2(data, IMAGE_PIXELS_MAX).convert("RGB")
        picture = Image.open(io.BytesIO(data))
        if picture.width * picture.height > IMAGE_PIXELS_MAX:
            raise ValueError(f"{picture.width} x {picture.height} px")
        return picture.convert("RGB")
    except Exception as error:  # a broken picture raises whatever its decoder does
        reason = " ".join(str(error).split())[:80]
        raise GltfError(f"a texture cannot be read: images[{index}]: {reason}") from None


def _file(document: Document, row: dict[str, Any]) -> bytes:
    if "uri" not in row:
        raise GltfError("a picture has neither uri nor bufferView")
    return document.resource(row["uri"])


def _image(texture: dict[str, Any]) -> int | None:
    """Number of a texture's picture, in a format that is read."""
    extensions = _object(texture, "extensions")
    found = _object(extensions, WEBP).get("source", texture.get("source"))
    if found is None:  # a plain copy is the same whatever is installed
        found = _object(extensions, BASIS).get("source")
    return found if isinstance(found, int) else None


def _repeats(document: Document, texture: dict[str, Any]) -> bool:
    if "sampler" not in texture:
        return True
    sampler = document.row("samplers", texture["sampler"])
    return all(sampler.get(key, REPEAT) == REPEAT for key in ("wrapS", "wrapT"))


def _matrix(transform: dict[str, Any]) -> np.ndarray:
    """Of KHR_texture_transform: scaled, turned anticlockwise as seen (v points down), moved."""
    scale = _numbers(transform, "scale", (1, 1))
    offset = _numbers(transform, "offset", (0, 0))
    (angle,) = _numbers(transform, "rotation", (0,))
    c, s = math.cos(angle), math.sin(angle)
    return np.array(
        [[c * scale[0], s * scale[1], offset[0]], [-s * scale[0], c * scale[1], offset[1]]]
    )


def _note_ignored(document: Document, material: dict[str, Any], metallic: dict[str, Any]) -> None:
    """What of a material is not shown."""
    mode = material.get("alphaMode", "OPAQUE")
    if mode != "OPAQUE":
        document.note(f"alpha mode {str(mode)[:10]} ignored, what is transparent is solid")
    for key, name in (("normalTexture", "normal map"), ("emissiveTexture", "emissive map")):
        if key in material:
            document.note(f"{name} ignored")
    if any(_numbers(material, "emissiveFactor", (0, 0, 0))):
        document.note("emissive colour ignored")
    if "metallicRoughnessTexture" in metallic:
        document.note("metallic-roughness map ignored")


def _object(row: dict[str, Any], key: str) -> dict[str, Any]:
    found = row.get(key, {})
    if not isinstance(found, dict):
        raise GltfError(f"'{key}' is no object")
    return found


def _numbers(row: dict[str, Any], key: str, default: tuple[float, ...]) -> list[float]:
    """As many finite numbers as the default has."""
    found = row.get(key, default)
    values = found if isinstance(found, list | tuple) else [found]
    good = len(values) == len(default) and all(
        isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        for value in values
    )
    if not good:
        raise GltfError(f"'{key}' is {str(found)[:40]}, needed {len(default)} numbers")
    return [float(value) for value in values]
