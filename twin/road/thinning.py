"""Lines with fewer points that stay close to the line."""

from __future__ import annotations

import numpy as np

ERROR_M = 0.05
"""Largest distance between a line that is saved and what it stands for [m]."""


def kept_points(at: np.ndarray, points: np.ndarray, error_m: float) -> np.ndarray:
    """Indices of points that are enough: chords between them stay within ``error_m``.

    The method is that of Ramer (1972, Computer Graphics and Image Processing 1, 244-256) and of
    Douglas and Peucker (1973, Cartographica 10, 112-122). Distances are taken at the same place
    along the line, so several lines that share their stations keep common ones.

    Args:
        at: rising places along the lines [N].
        points: one or more lines [N, L, 3] [m].
        error_m: largest distance of any of them.
    """
    count = len(at)
    keep = np.zeros(count, bool)
    keep[[0, -1]] = True
    spans = [(0, count - 1)]
    while spans:
        first, last = spans.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        share = (at[inner] - at[first]) / max(at[last] - at[first], 1e-12)
        chord = points[first] + share[:, None, None] * (points[last] - points[first])
        off = np.sqrt(((points[inner] - chord) ** 2).sum(axis=2)).max(axis=1)
        worst = int(np.argmax(off))
        if off[worst] > error_m:
            middle = first + 1 + worst
            keep[middle] = True
            spans += [(first, middle), (middle, last)]
    return np.flatnonzero(keep)
