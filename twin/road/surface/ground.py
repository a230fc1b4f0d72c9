"""The ground around roads: a grid below the lowest road near each of its corners."""

from __future__ import annotations

import math

import numpy as np

from twin.road.surface.patch import SurfacePatch

MARGIN_M = 80.0
"""How far it goes on beyond the roads [m]."""
PITCH_M = 8.0
"""Distance of its corners at least [m]."""
CELLS_MAX = 300
"""Most cells along an axis; larger networks have larger cells."""
BELOW_M = 0.03
"""How far below the roads it lies [m]."""


def ground_around(points_m: np.ndarray) -> SurfacePatch:
    """The ground around road points [N, 3], which are at most some metres apart along lanes.

    Every corner lies below all road points of the cells around it and their neighbours; where there
    are none, in the mean of the corners around it, from the roads outwards.
    """
    low = points_m[:, :2].min(axis=0) - MARGIN_M
    high = points_m[:, :2].max(axis=0) + MARGIN_M
    pitch = max(PITCH_M, float((high - low).max()) / CELLS_MAX)
    columns, rows = (max(1, math.ceil(n)) for n in ((high - low) / pitch).tolist())
    column, row = np.floor((points_m[:, :2] - low) / pitch).astype(int).T
    heights = np.full((columns + 1, rows + 1), np.inf)
    for across in (0, 1):
        for along in (0, 1):
            np.minimum.at(heights, (column + across, row + along), points_m[:, 2])
    heights = _lowest_around(heights) - BELOW_M
    heights = _filled(heights)
    x, y = low[0] + pitch * np.arange(columns + 1), low[1] + pitch * np.arange(rows + 1)
    corners = np.stack([*np.meshgrid(x, y, indexing="ij"), heights], axis=-1).reshape(-1, 3)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij"))
    a, b = i * (rows + 1) + j, (i + 1) * (rows + 1) + j
    faces = np.concatenate([np.stack([a, b, b + 1], 1), np.stack([a, b + 1, a + 1], 1)])
    return SurfacePatch("ground", "", corners, faces.astype(np.int32))


def _shifted(grid: np.ndarray, fill: float) -> list[np.ndarray]:
    """The grid moved by one each of eight ways, in a fixed order."""
    wide = np.pad(grid, 1, constant_values=fill)
    columns, rows = grid.shape
    return [
        wide[1 + i : 1 + i + columns, 1 + j : 1 + j + rows]
        for i in (-1, 0, 1)
        for j in (-1, 0, 1)
        if (i, j) != (0, 0)
    ]


def _lowest_around(heights: np.ndarray) -> np.ndarray:
    lowest = heights
    for moved in _shifted(heights, np.inf):
        lowest = np.minimum(lowest, moved)
    # Where no road is near nothing is known yet.
    return lowest


def _filled(heights: np.ndarray) -> np.ndarray:
    known = np.isfinite(heights)
    filled = np.where(known, heights, 0.0)
    while not known.all():
        total, count = np.zeros(filled.shape), np.zeros(filled.shape)
        for values, there in zip(_shifted(filled, 0.0), _shifted(known, False), strict=True):
            total += np.where(there, values, 0.0)
            count += there
        reached = ~known & (count > 0.0)
        filled = np.where(reached, total / np.maximum(count, 1.0), filled)
        known |= reached
    return filled
