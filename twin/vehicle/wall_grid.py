"""Which walls are near a place: a grid over the static colliders, made once on the host.

A street has hundreds of walls, and every vehicle asks at every physics step which it may touch. A
cell lists those that a vehicle whose place is in it can reach, in ascending order: who asks a cell
meets the same walls in the same order as who asks all.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from twin.base.portable.whole import whole_within

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

CELL_M = 8.0
"""Side of a cell at least [m]."""
CELLS_MAX = 256
"""Most cells along an axis; larger worlds have larger cells."""
MARGIN_M = 2.0
"""How far a contact may push a vehicle before it asks again, at the next physics step [m]."""


@wp.struct
class WallGrid:
    """A grid for kernels."""

    low: wp.vec2d
    """Corner of the first cell [m]."""
    side: wp.float64
    """Of a cell [m]."""
    columns: wp.int32
    rows: wp.int32
    first: wp.array(dtype=wp.int32)
    """Where each cell's walls begin in ``walls`` [rows * columns + 1]."""
    walls: wp.array(dtype=wp.int32)
    """Indices of colliders, cell by cell."""


@wp.func
def walls_near(grid: WallGrid, x: wp.float64, y: wp.float64) -> wp.vec2i:
    """First and last + 1 of ``grid.walls`` that a vehicle at a place can touch."""
    column = whole_within(wp.floor((x - grid.low[0]) / grid.side), -1, grid.columns)
    row = whole_within(wp.floor((y - grid.low[1]) / grid.side), -1, grid.rows)
    if column < 0 or row < 0 or column >= grid.columns or row >= grid.rows:
        return wp.vec2i(0, 0)
    cell = row * grid.columns + column
    return wp.vec2i(grid.first[cell], grid.first[cell + 1])


def wall_grid(colliders: np.ndarray, extent_m: float, device: wp.Device) -> WallGrid:
    """The grid of ``colliders`` [K, 5] (x, y, yaw, half length, half width) for vehicles no corner
    of which is farther from their place than ``extent_m``."""
    grid = WallGrid()
    grid.side = CELL_M
    count = len(colliders)
    reach = colliders[:, 3] + colliders[:, 4] + (extent_m + MARGIN_M)
    low = (colliders[:, :2] - reach[:, None]).min(axis=0) if count else np.zeros(2)
    high = (colliders[:, :2] + reach[:, None]).max(axis=0) if count else np.zeros(2)
    grid.side = max(CELL_M, float((high - low).max()) / (CELLS_MAX - 1))
    grid.low = wp.vec2d(*low)
    grid.columns, grid.rows = (int(n) for n in np.floor((high - low) / grid.side) + 1)
    cells: list[list[int]] = [[] for _ in range(grid.columns * grid.rows)]
    first = np.floor((colliders[:, :2] - reach[:, None] - low) / grid.side).astype(int)
    last = np.floor((colliders[:, :2] + reach[:, None] - low) / grid.side).astype(int)
    for wall, (begin, end) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        for row in range(begin[1], end[1] + 1):
            for column in range(begin[0], end[0] + 1):
                cells[row * grid.columns + column].append(wall)
    starts = np.cumsum([0, *(len(cell) for cell in cells)])
    grid.first = wp.array(starts, dtype=wp.int32, device=device)
    listed = [wall for cell in cells for wall in cell]
    grid.walls = wp.array(listed or [0], dtype=wp.int32, device=device)
    return grid
