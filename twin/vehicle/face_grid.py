"""Which faces of a ground lie below or above a place: a grid over them, made once on the host.

A cell lists the faces whose bounds reach into it, in ascending order. Nothing here follows from a
device's own hierarchy, so every device finds the same faces in the same order.
"""

from __future__ import annotations

import numpy as np
import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

CELL_M = 1.0
"""Side of a cell at least [m]."""
CELLS_MAX = 1024
"""Most cells along an axis; larger grounds have larger cells."""
_MARGIN_M = 1e-6
_LISTED_MAX = 16
"""Mean number of cells of a face at most, beyond the first million."""

_EDGE = wp.constant(wp.float64(-1.0e-9))
"""Twice the area by which a place may lie outside of an edge [m^2]; nobody falls between faces."""
_ZERO = wp.constant(wp.float64(0.0))


@wp.struct
class FaceGrid:
    """A grid for kernels."""

    low: wp.vec2d
    """Corner of the first cell [m]."""
    side: wp.float64
    """Of a cell [m]."""
    columns: wp.int32
    rows: wp.int32
    first: wp.array(dtype=wp.int32)
    """Where each cell's faces begin in ``faces`` [rows * columns + 1]."""
    faces: wp.array(dtype=wp.int32)
    """Faces, cell by cell."""
    corners: wp.array2d(dtype=wp.vec3)
    """[F, 3], seen from above to the left of one another."""


@wp.func
def faces_near(grid: FaceGrid, x: wp.float64, y: wp.float64) -> wp.vec2i:
    """First and last + 1 of ``grid.faces`` that can lie at a place."""
    column = wp.floor((x - grid.low[0]) / grid.side)
    row = wp.floor((y - grid.low[1]) / grid.side)
    # Written so that a place that is no number is outside.
    if not (
        column >= _ZERO
        and row >= _ZERO
        and column < wp.float64(grid.columns)
        and row < wp.float64(grid.rows)
    ):
        return wp.vec2i(0, 0)
    cell = wp.int32(row) * grid.columns + wp.int32(column)
    return wp.vec2i(grid.first[cell], grid.first[cell + 1])


@wp.func
def corner_of(grid: FaceGrid, face: wp.int32, corner: wp.int32) -> wp.vec3d:
    """A corner of a face [m]."""
    p = grid.corners[face, corner]
    return wp.vec3d(wp.float64(p[0]), wp.float64(p[1]), wp.float64(p[2]))


@wp.func
def _beside(a: wp.vec3d, b: wp.vec3d, p: wp.vec3d) -> wp.float64:
    """Twice the area of the triangle of an edge and a place; positive on the edge's left [m^2]."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


@wp.func
def is_below(grid: FaceGrid, face: wp.int32, p: wp.vec3d) -> wp.bool:
    """Whether a face lies below or above a place, edges included."""
    a = corner_of(grid, face, 0)
    b = corner_of(grid, face, 1)
    if _beside(a, b, p) < _EDGE:
        return False
    c = corner_of(grid, face, 2)
    return _beside(b, c, p) >= _EDGE and _beside(c, a, p) >= _EDGE


@wp.func
def face_normal(grid: FaceGrid, face: wp.int32) -> wp.vec3d:
    """Unit normal of a face, upwards."""
    a = corner_of(grid, face, 0)
    return wp.normalize(wp.cross(corner_of(grid, face, 1) - a, corner_of(grid, face, 2) - a))


def face_grid(corners_m: np.ndarray, device: wp.Device) -> FaceGrid:
    """The grid of faces, float32 [F, 3, 3]: face, corner, axis."""
    corners = _from_above(corners_m)
    low = corners[:, :, :2].min(axis=1).astype(float) - _MARGIN_M
    high = corners[:, :, :2].max(axis=1).astype(float) + _MARGIN_M
    begin, size = low.min(axis=0), (high.max(axis=0) - low.min(axis=0))
    side = max(CELL_M, float(size.max()) / (CELLS_MAX - 1))
    while True:
        first = np.floor((low - begin) / side).astype(np.int64)
        count = np.floor((high - begin) / side).astype(np.int64) - first + 1
        cells = count.prod(axis=1)
        if cells.sum() <= _LISTED_MAX * len(corners) + 1_000_000:
            break
        side *= 2.0
    grid = FaceGrid()
    grid.low, grid.side = wp.vec2d(*begin), side
    columns, rows = (int(n) for n in np.floor(size / side) + 1)
    grid.columns, grid.rows = columns, rows
    face = np.repeat(np.arange(len(corners)), cells)
    place = np.arange(len(face)) - np.repeat(np.cumsum(cells) - cells, cells)
    column = first[face, 0] + place % count[face, 0]
    row = first[face, 1] + place // count[face, 0]
    cell = row * columns + column
    order = np.argsort(cell, kind="stable")
    starts = np.searchsorted(cell[order], np.arange(columns * rows + 1))
    grid.first = wp.array(starts, dtype=wp.int32, device=device)
    grid.faces = wp.array(face[order], dtype=wp.int32, device=device)
    grid.corners = wp.array(corners, dtype=wp.vec3, device=device)
    return grid


def _from_above(corners_m: np.ndarray) -> np.ndarray:
    """Corners in the order in which a face looks up."""
    a, b, c = corners_m[:, :, :2].astype(float).transpose(1, 0, 2)
    d, e = b - a, c - a
    down = d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0] < 0.0
    return np.where(down[:, None, None], corners_m[:, [0, 2, 1]], corners_m)
