"""Detections from rows that one can read, for tests of scores."""

from __future__ import annotations

import numpy as np

from devkit.detector.decode import Detections


def detections_of(names: tuple[str, ...], *rows: tuple[float, ...]) -> Detections:
    """Rows (image, class, confidence, x, y, width, height)."""
    data = np.array(rows, np.float64).reshape(-1, 7)
    return Detections(
        names,
        data[:, 0].astype(int),
        data[:, 1].astype(int),
        data[:, 2],
        data[:, 3:],
        np.arange(len(data)),
    )
