"""Detections from rows that one can read, for tests of scores."""

from __future__ import annotations

import numpy as np

from devkit.detector.decode import DetectionBatch


def detections_of(names: tuple[str, ...], *rows: tuple[float, ...]) -> DetectionBatch:
    """Rows (image, class, confidence, x, y, width, height)."""
    data = np.array(rows, np.float64).reshape(-1, 7)
    return DetectionBatch(
        names,
        data[:, 0].astype(int),
        data[:, 1].astype(int),
        data[:, 2],
        data[:, 3:],
        np.arange(len(data)),
    )
