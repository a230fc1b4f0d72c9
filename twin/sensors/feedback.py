"""Sensors that read the state: by-wire feedback and ambient light and visibility."""

from __future__ import annotations

import numpy as np

from schemas.messages import VEHICLE_COLUMNS
from twin.vehicle.state import COLUMN

_COLUMNS = [COLUMN[name] for name in VEHICLE_COLUMNS]


def by_wire(state: np.ndarray, active: np.ndarray) -> np.ndarray:
    """State [S, T] -> :data:`schemas.messages.VEHICLE_COLUMNS` [S, 7]; zeros where inactive."""
    return np.where(active[:, None], state[:, _COLUMNS], 0.0)


def environment(
    illuminance_lx: np.ndarray, extinction_per_m: np.ndarray, active: np.ndarray
) -> np.ndarray:
    """[S] and [S] -> :data:`schemas.messages.ENVIRONMENT_COLUMNS` [S, 2]; zeros where inactive."""
    both = np.stack([illuminance_lx, extinction_per_m], axis=1)
    return np.where(active[:, None], both, 0.0)
