"""Pictures of a mesh file, made ready for rendering: colours, holes and maps."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from twin.world.meshes.srgb import linear, srgb

TEXTURE_SIDE_MAX = 2048
"""Longer sides of images are scaled down to this [px]."""
TEXTURES_MAX = 64
"""Most images of colours of one mesh file."""
MAPS_MAX = 128
"""Most other maps of one mesh file; the others are left out."""
_IMAGE_PIXELS_MAX = 1 << 28

_Key = tuple[str, int, tuple[float, ...]]


@dataclass(slots=True)
class PartImages:
    """Pictures that are made ready once, by their object and what is done with them."""

    path: Path
    notes: list[str]
    """What was made smaller or left out, one line each."""
    _ready: dict[_Key, np.ndarray] = field(default_factory=dict)
    _scaled: set[int] = field(default_factory=set)

    @property
    def colors(self) -> int:
        """Number of images of colours."""
        return self._count("color")

    def color(self, image: Any, factor: np.ndarray | None) -> np.ndarray:
        """The image (PIL) as uint8 sRGB [h, w, 3], scaled down to the limit and times the
        material's factor.

        Raises:
            ValueError: it cannot be read; one line.
        """
        key = ("color", id(image), () if factor is None else tuple(factor))
        if key not in self._ready:
            rgb = self._small(image, "RGB")
            if factor is not None and (factor < 0.999).any():
                rgb = np.rint(255.0 * srgb(linear(rgb / 255.0) * factor)).astype(np.uint8)
            self._ready[key] = rgb
        return self._ready[key]

    def map(self, image: Any) -> np.ndarray | None:
        """Another map of a material, uint8 [h, w, 3] as it is; None: there are too many.

        Raises:
            ValueError: it cannot be read; one line.
        """
        key = ("map", id(image), ())
        if key not in self._ready:
            if self._count("map") >= MAPS_MAX:
                note = f"{self.path.name}: more than {MAPS_MAX} maps, the others left out"
                if note not in self.notes:
                    self.notes.append(note)
                return None
            self._ready[key] = self._small(image, "RGB")
        return self._ready[key]

    def alpha(self, image: Any) -> np.ndarray | None:
        """Alpha of an image, uint8 [h, w]; None: it is opaque.

        Raises:
            ValueError: it cannot be read; one line.
        """
        if image.mode != "RGBA":
            return None
        key = ("alpha", id(image), ())
        if key not in self._ready:
            self._ready[key] = self._small(image, "RGBA")[:, :, 3].copy()
        return self._ready[key]

    def _count(self, kind: str) -> int:
        return sum(key[0] == kind for key in self._ready)

    def _small(self, image: Any, mode: str) -> np.ndarray:
        """Values of an image, scaled down to the limit by means over areas."""
        try:
            if image.width * image.height > _IMAGE_PIXELS_MAX:
                raise ValueError(f"{image.width} x {image.height} px")
            converted = image.convert(mode)
            values = np.asarray(converted)
        except Exception as error:  # a broken picture fails here, when it is decoded
            reason = " ".join(str(error).split())[:120]
            raise ValueError(f"{self.path}: a texture cannot be read: {reason}") from None
        height, width = values.shape[:2]
        side = max(height, width)
        if side <= TEXTURE_SIDE_MAX:
            return values
        size = tuple(max(1, round(n * TEXTURE_SIDE_MAX / side)) for n in (width, height))
        if id(image) not in self._scaled:
            self._scaled.add(id(image))
            self.notes.append(
                f"{self.path.name}: a texture of {width} x {height} px scaled to "
                f"{size[0]} x {size[1]}"
            )
        return np.asarray(converted.resize(size, Image.Resampling.BOX))
