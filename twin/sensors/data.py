"""What a sensor hands over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class SensorData:
    """One sensor's values for all slots; inactive slots hold zeros."""

    values: np.ndarray
    """[S, ...]; valid until the next call of the engine."""
    count: np.ndarray | None = None
    """int32 [S]: valid rows of ragged data."""
