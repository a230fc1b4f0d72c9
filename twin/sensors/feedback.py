"""Sensors that read the state: by-wire feedback and ambient light and visibility."""

from __future__ import annotations

import numpy as np

from schemas.messages import VEHICLE_COLUMNS
from twin.vehicle.planar import COLUMN

# The planar vehicle has no handbrake: its column stays zero.
_FOUND = [(i, COLUMN[name]) for i, name in enumerate(VEHICLE_COLUMNS) if name in COLUMN]
_TO, _FROM = ([pair[k] for pair in _FOUND] for k in range(2))


def by_wire(state: np.ndarray, active: np.ndarray) -> np.ndarray:
    """State [S, T] -> :data:`schemas.messages.VEHICLE_COLUMNS` [S, 7]; zeros where inactive."""
    feedback = np.zeros((len(state), len(VEHICLE_COLUMNS)))
    feedback[:, _TO] = np.where(active[:, None], state[:, _FROM], 0.0)
    return feedback


def environment(
    illuminance_lx: np.ndarray, extinction_per_m: np.ndarray, active: np.ndarray
) -> np.ndarray:
    """[S] and [S] -> :data:`schemas.messages.ENVIRONMENT_COLUMNS` [S, 2]; zeros where inactive."""
    both = np.stack([illuminance_lx, extinction_per_m], axis=1)
    return np.where(active[:, None], both, 0.0)
