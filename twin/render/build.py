"""Compile options of the large render kernels: what matters on a GPU, found by measuring."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import warp as wp


@dataclass(frozen=True, slots=True)
class KernelOptions:
    """Compile options of one kernel."""

    block: int = 128
    """Threads of a block; 1 on a CPU."""
    blocks: int = 0
    """Blocks that fit a multiprocessor at least, which bounds the registers; 0: no bound."""
    pixels: int = 1
    """Neighbouring pixels that a thread works on: of one tile, one after another."""
    shell_first: bool = False
    """Second rays through a pane look for the body right behind it before all else: most panes
    belong to closed bodies, and a core has nobody beside it that would wait for the others."""

    def arguments(self) -> dict[str, Any]:
        """Arguments for ``wp.kernel``: a module of its own, with the same bits on every device."""
        arguments: dict[str, Any] = {
            "module": "unique",
            "enable_backward": False,
            "module_options": {"fuse_fp": False},
        }
        if self.blocks:
            arguments["launch_bounds"] = (self.block, self.blocks)
        return arguments


@dataclass(frozen=True, slots=True)
class Features:
    """What the materials of a world ask of the kernels; compiled in only where it is needed."""

    holes: bool = False
    """Some faces have holes that rays pass."""
    looks: bool = False
    """Some faces have normals or colours at their corners, maps, or images that do not repeat."""


NONE = Features()
"""Those of a generated street."""


@dataclass(frozen=True, slots=True)
class Tuning:
    """Compile options of a camera's kernels."""

    visibility: KernelOptions
    look: KernelOptions
    mirror: KernelOptions
    picture: KernelOptions
    hits: KernelOptions | None = None
    """Of the kernel that traces second rays; None: one kernel traces and shades them."""
    light: KernelOptions | None = None
    """Of the kernel that shades what they have met."""
    light_detailed: KernelOptions | None = None
    """Of the one for faces with details."""
    without: frozenset[str] = frozenset()
    """Parts of :data:`twin.render.picture.PARTS` to leave out, to see what they cost."""


CPU = Tuning(
    visibility=KernelOptions(block=1),
    look=KernelOptions(block=1),
    mirror=KernelOptions(block=1, shell_first=True),
    picture=KernelOptions(block=1, pixels=32),
)
CUDA = Tuning(
    visibility=KernelOptions(blocks=8),
    look=KernelOptions(blocks=8),
    mirror=KernelOptions(blocks=4),
    picture=KernelOptions(blocks=5),
    hits=KernelOptions(blocks=6),
    light=KernelOptions(blocks=5),
    light_detailed=KernelOptions(blocks=4),
)


def tuning_for(device: wp.Device) -> Tuning:
    """The usual one."""
    return CPU if device.is_cpu else CUDA
