"""The table of pictures: what a camera gives per pixel. Topics, arrays, memory and the allowed
words of ``outputs`` derive from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureKind:
    """Declaration of an array that has values for every pixel."""

    name: str
    """Name of its message, without the name of the camera."""
    dtype: Literal["|u1", "<i4", "<f4"]
    values: int = 1
    """Values per pixel; 1: the array has no axis for them."""
    meaning: str
    """What a value is, for the table of topics."""

    def shape(self, slots: int, height: int, width: int) -> tuple[int, ...]:
        """[S, H, W], and the values of a pixel where there are several."""
        return (slots, height, width, *((self.values,) if self.values > 1 else ()))


MAIN = PictureKind(name="camera", dtype="|u1", values=3, meaning="rgb8")
"""What every camera gives."""

OUTPUTS = (
    PictureKind(name="depth", dtype="<f4", meaning="metres"),
    PictureKind(name="instance", dtype="<i4", meaning="ids"),
    PictureKind(name="semantic", dtype="|u1", meaning="classes"),
    PictureKind(name="normal", dtype="<f4", values=3, meaning="camera axes"),
    PictureKind(name="flow", dtype="<f4", values=2, meaning="pixels"),
)
"""What a camera may be asked for besides, in the order of kernels and messages.

``depth``: along the camera's axis [m], +inf for the sky; ``instance``: -1 for none; ``semantic``:
index of :data:`schemas.messages.SEMANTIC_CLASSES`; ``normal``: unit, in the camera's axes (x right,
y down, z forward), 0 for the sky; ``flow``: where the point is, minus where it was in the picture
before (x, y) [px].
"""

OUTPUTS_BY_NAME = {kind.name: kind for kind in OUTPUTS}
"""Output -> its declaration."""

if TYPE_CHECKING:
    ImageOutput = str
else:
    ImageOutput = Literal[tuple(OUTPUTS_BY_NAME)]
"""What a camera gives beside pictures and boxes."""
