"""Cubics one after another along a road or a section."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.road.opendrive.records import Cubic


class CubicProfile:
    """A value by distance; 0 before the first cubic, and everywhere if there is none."""

    __slots__ = ("_coefficients", "_starts")

    def __init__(self, cubics: Sequence[Cubic]) -> None:
        rows = [(0.0, 0.0, 0.0, 0.0), *((c.a, c.b, c.c, c.d) for c in cubics)]
        self._starts = np.array([c.start_m for c in cubics])
        self._coefficients = np.array(rows)

    def at(self, distance_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The values, and their slopes, at distances of any shape."""
        index = np.searchsorted(self._starts, distance_m, "right")
        start = np.append(0.0, self._starts)[index]
        a, b, c, d = np.moveaxis(self._coefficients[index], -1, 0)
        x = distance_m - start
        return a + x * (b + x * (c + x * d)), b + x * (2.0 * c + x * 3.0 * d)
