"""What cameras see of glTF materials: base colour, holes, own light, maps, and what is left out."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image

from twin.world.meshes.gltf.document import EMISSIVE_STRENGTH, Document, GltfError
from twin.world.meshes.gltf.ktx2 import is_ktx2, read_ktx2
from twin.world.meshes.gltf.maps import GltfMap, map_of, numbers_of, object_of

GREY = 0.35
"""Linear reflectance of what has no material: the standard's white shines like nothing outdoors."""
BLEND_CUTOFF = 0.5
"""What is blended is there from this alpha on."""
IMAGE_PIXELS_MAX = 1 << 28
"""Largest picture that is decoded [px]."""


@dataclass(frozen=True, slots=True)
class GltfLook:
    """A material."""

    factor: np.ndarray
    """Linear RGB that the base colour is multiplied with, float64 [3]."""
    base: GltfMap | None = None
    """Base colour; None: it has no picture."""
    alpha: float = 1.0
    """Factor of alpha."""
    cutoff: float = 0.0
    """Nothing is there where alpha lies below; 0: it is opaque."""
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Linear RGB, with the strength."""
    metallic: float = 0.0
    roughness: float = 1.0
    normal_scale: float = 1.0
    maps: tuple[GltfMap | None, GltfMap | None, GltfMap | None] = (None, None, None)
    """By :data:`twin.world.meshes.details.EMISSION`, ``NORMAL`` and ``SHINE``."""

    @property
    def first_map(self) -> GltfMap | None:
        """The map whose coordinates its faces carry; None: it has no map."""
        return next((found for found in (self.base, *self.maps) if found is not None), None)


def look_of(document: Document, index: object) -> GltfLook:
    """The material of this number; None: the default material. What is ignored is noted.

    Raises:
        GltfError: it cannot be read.
    """
    if index is None:
        return GltfLook(np.full(3, GREY))
    material = document.row("materials", index)
    surface = object_of(material, "pbrMetallicRoughness")
    factor = numbers_of(surface, "baseColorFactor", (1, 1, 1, 1))
    if "occlusionTexture" in material:
        document.note("occlusion map ignored")
    if material.get("doubleSided") is not True:
        document.note("single-sided faces are seen from both sides")
    normal = object_of(material, "normalTexture")
    emission = _emission(material)
    return GltfLook(
        np.array(factor[:3]),
        base=map_of(document, surface, "baseColorTexture"),
        alpha=factor[3],
        cutoff=_cutoff(document, material),
        emission=emission,
        metallic=numbers_of(surface, "metallicFactor", (1,))[0],
        roughness=numbers_of(surface, "roughnessFactor", (1,))[0],
        normal_scale=numbers_of(normal, "scale", (1,))[0],
        maps=(
            map_of(document, material, "emissiveTexture") if any(emission) else None,
            map_of(document, material, "normalTexture"),
            map_of(document, surface, "metallicRoughnessTexture"),
        ),
    )


def read_picture(document: Document, index: int) -> Image.Image:
    """A picture of the file, RGB, or RGBA if some of it may be transparent.

    Raises:
        GltfError: it is not there, too large, or cannot be decoded.
        OSError: its file cannot be read.
    """
    row = document.row("images", index)
    data = document.view(row["bufferView"])[0] if "bufferView" in row else _file(document, row)
    try:
        if is_ktx2(data):
            picture = read_ktx2(data, IMAGE_PIXELS_MAX)
        else:
            picture = Image.open(io.BytesIO(data))
            if picture.width * picture.height > IMAGE_PIXELS_MAX:
                raise ValueError(f"{picture.width} x {picture.height} px")
        return picture.convert("RGBA" if picture.has_transparency_data else "RGB")
    except Exception as error:  # a broken picture raises whatever its decoder does
        reason = " ".join(str(error).split())[:80]
        raise GltfError(f"a texture cannot be read: images[{index}]: {reason}") from None


def _file(document: Document, row: dict[str, Any]) -> bytes:
    if "uri" not in row:
        raise GltfError("a picture has neither uri nor bufferView")
    return document.resource(row["uri"])


def _emission(material: dict[str, Any]) -> tuple[float, float, float]:
    """Emissive factor times KHR_materials_emissive_strength."""
    red, green, blue = numbers_of(material, "emissiveFactor", (0, 0, 0))
    extension = object_of(object_of(material, "extensions"), EMISSIVE_STRENGTH)
    (strength,) = numbers_of(extension, "emissiveStrength", (1,))
    if min(red, green, blue, strength) < 0.0:
        raise GltfError("a material emits less than nothing")
    return red * strength, green * strength, blue * strength


def _cutoff(document: Document, material: dict[str, Any]) -> float:
    """Alpha below which nothing is there; 0: alpha does not count."""
    mode = material.get("alphaMode", "OPAQUE")
    if mode == "OPAQUE":
        return 0.0
    if mode == "MASK":
        return numbers_of(material, "alphaCutoff", (0.5,))[0]
    document.note(f"alpha mode {str(mode)[:10]} taken as holes below {BLEND_CUTOFF}")
    return BLEND_CUTOFF
