"""Street lamps of a world for kernels: two rows, or a grid that tells which lamps are near."""

from __future__ import annotations

import numpy as np
import warp as wp

from twin.render.light.lamps import LAMPS_GLOWING, StreetLamps
from twin.world.scene import Furniture
from twin.world.street.build import World

LAMP_CELL_M = 4.0
"""Width of a cell [m]."""
_LAMP_REACH_M = 40.0
"""Cells reach this far beyond the outermost lamps [m]."""


def street_lamps(world: World, furniture: Furniture, device: wp.Device) -> StreetLamps:
    """The street lamps of ``world`` for kernels."""
    found = StreetLamps()
    found.spacing = furniture.lamp_spacing_m
    found.height = furniture.lamp_height_m
    found.intensity = furniture.lamp_intensity_cd
    found.right = wp.vec2(*world.lamps_right)
    found.left = wp.vec2(*world.lamps_left)
    found.scattered = int(world.lamps is not None)
    at = np.zeros((0, 2)) if world.lamps is None else world.lamps
    near, corner = nearest_lamps(at)
    found.at = wp.array(at.astype(np.float32), dtype=wp.vec2, device=device)
    found.near = wp.array(near, dtype=wp.int32, device=device, ndim=3)
    found.corner = wp.vec2(*corner)
    found.cell = LAMP_CELL_M
    return found


def nearest_lamps(at_m: np.ndarray) -> tuple[np.ndarray, tuple[float, float]]:
    """The lamps nearest to the middle of each cell of a grid around the lamps ``at_m`` [L, 2].

    Returns:
        int32 [rows, columns, LAMPS_GLOWING], nearest first, -1 where there are fewer lamps;
        world x, y of the grid's corner [m].
    """
    if not len(at_m):
        return np.zeros((0, 0, LAMPS_GLOWING), np.int32), (0.0, 0.0)
    corner = np.floor(at_m.min(axis=0) - _LAMP_REACH_M)
    columns, rows = (
        np.ceil((at_m.max(axis=0) + _LAMP_REACH_M - corner) / LAMP_CELL_M).astype(int).tolist()
    )
    x = corner[0] + LAMP_CELL_M * (np.arange(columns) + 0.5)
    y = corner[1] + LAMP_CELL_M * (np.arange(rows) + 0.5)
    apart = (x[None, :, None] - at_m[:, 0]) ** 2 + (y[:, None, None] - at_m[:, 1]) ** 2
    order = np.argsort(apart, axis=-1, kind="stable")[..., :LAMPS_GLOWING]
    near = np.full((rows, columns, LAMPS_GLOWING), -1, np.int32)
    near[..., : order.shape[-1]] = order
    return near, (float(corner[0]), float(corner[1]))
