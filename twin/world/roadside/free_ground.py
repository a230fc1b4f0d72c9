"""Which ground beside roads is free: cells that lanes and houses take."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from twin.road.surface.patch import SurfacePatch

CELL_M = 1.0
"""Width of a cell [m]."""
_SPAN = 1 << 20
"""More cells than any world has along an axis."""


class FreeGround:
    """Cells of the plane that something stands on or that lanes cover."""

    def __init__(self, patches: Iterable[SurfacePatch]) -> None:
        taken = [self._of_lanes(patch) for patch in patches if patch.kind == "lane"]
        self._taken = np.unique(np.concatenate([np.zeros(0, np.int64), *taken]))

    def is_free(self, points_m: np.ndarray) -> bool:
        """Whether none of the cells of points [N, 2] is taken."""
        keys = _keys(points_m)
        if not len(self._taken):
            return True
        at = np.minimum(np.searchsorted(self._taken, keys), len(self._taken) - 1)
        return not bool((self._taken[at] == keys).any())

    def take(self, points_m: np.ndarray) -> None:
        """Take the cells of points [N, 2]."""
        self._taken = np.union1d(self._taken, _keys(points_m))

    @staticmethod
    def _of_lanes(patch: SurfacePatch) -> np.ndarray:
        """Cells of a patch's triangles: places of each that are at most a cell apart."""
        corners = patch.points_m[patch.faces][:, :, :2]
        longest = np.hypot(*(corners - np.roll(corners, 1, axis=1)).reshape(-1, 2).T)
        steps = np.ceil(longest.reshape(-1, 3).max(axis=1) / (0.7 * CELL_M)).astype(int)
        keys = []
        for count in np.unique(steps).tolist():
            i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij")
            inside = i + j <= count
            shares = np.stack([i[inside], j[inside], (count - i - j)[inside]]) / max(count, 1)
            mine = corners[steps == count]
            # In pieces: a network has millions of them.
            for first in range(0, len(mine), 2000):
                places = np.einsum("ks,fkx->fsx", shares, mine[first : first + 2000])
                keys.append(np.unique(_keys(places.reshape(-1, 2))))
        return np.unique(np.concatenate([np.zeros(0, np.int64), *keys]))


def _keys(points_m: np.ndarray) -> np.ndarray:
    cells = np.floor(points_m / CELL_M).astype(np.int64)
    keys: np.ndarray = cells[:, 0] * _SPAN + cells[:, 1]
    return keys
