"""What a camera gives besides its picture, and what the kernel writes for it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from schemas.kinds import picture

OUTPUTS: dict[str, tuple[Any, int]] = {
    kind.name: (wp.dtype_from_numpy(np.dtype(kind.dtype)), kind.values) for kind in picture.OUTPUTS
}
"""Type and values per pixel of every output [S, H, W, ...]; what they mean is declared in
:data:`schemas.kinds.picture.OUTPUTS`."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What the shading kernel writes; one kernel is compiled for every such set."""

    hdr: bool = False
    """Linear signal for the post-processing instead of 8 bits."""
    second: bool = True
    """Second rays: what smooth surfaces mirror and glass lets through."""
    depth: bool = False
    instance: bool = False
    semantic: bool = False
    normal: bool = False
    flow: bool = False

    @classmethod
    def of(
        cls, outputs: Iterable[str], *, hdr: bool, second: bool, depth: bool, flow: bool
    ) -> Wanted:
        """Outputs that a camera declares and what its effects need."""
        names = {*outputs, *(("depth",) if depth else ()), *(("flow",) if flow else ())}
        return cls(hdr=hdr, second=second, **{name: name in names for name in OUTPUTS})


@wp.struct
class Buffers:
    """Arrays of all outputs; those not asked for are empty."""

    image: wp.array4d(dtype=wp.uint8)
    hdr: wp.array4d(dtype=wp.float16)
    depth: wp.array3d(dtype=wp.float32)
    instance: wp.array3d(dtype=wp.int32)
    semantic: wp.array3d(dtype=wp.uint8)
    normal: wp.array4d(dtype=wp.float32)
    flow: wp.array4d(dtype=wp.float32)
    boxes: wp.array3d(dtype=wp.int32)


def bytes_per_pixel(wanted: Wanted) -> int:
    """Memory of a slot's outputs, per pixel of the picture [bytes]."""
    total = 3 + (6 if wanted.hdr else 0)
    for name, (dtype, values) in OUTPUTS.items():
        if getattr(wanted, name):
            total += values * wp.types.type_size_in_bytes(dtype)
    return total
