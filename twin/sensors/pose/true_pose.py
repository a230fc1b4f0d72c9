"""The true pose: position and rotation as they are, for protocols that send them, and for tests."""

from __future__ import annotations

import numpy as np
import warp as wp

from schemas.case import Case
from schemas.kinds.sensors.pose import COLUMNS
from schemas.messages import SensorErrors
from twin.sensors.mount import SensorMount
from twin.sensors.truth import TRUTH

_COLUMNS = [TRUTH.index(name) for name in COLUMNS]


class TruePose:
    """Poses of all slots, columns :data:`schemas.kinds.sensors.pose.COLUMNS`."""

    def __init__(self, mount: SensorMount) -> None:
        self.every = mount.every
        """Control periods between two readings."""
        self._active = np.zeros(mount.slots, np.bool_)

    def reset(self, slot: int, case: Case) -> None:
        """Begin a case; it changes nothing about the truth."""
        assert case.variation.sensors.pose.on
        self._active[slot] = True

    def clear(self, slot: int) -> None:
        """Make a slot inactive."""
        self._active[slot] = False

    def hold(self, slot: int, *, held: bool) -> None:
        """Leave a slot out, or take it in again; there is nothing to remember."""
        self._active[slot] = not held

    def save(self, _slot: int) -> dict[str, np.ndarray]:
        """A reading follows from the truth alone."""
        return {}

    def restore(self, slot: int, saved: dict[str, np.ndarray]) -> None:
        """There is nothing to go on with."""

    def modulate(self, slot: int, errors: SensorErrors) -> None:
        """The truth has no errors."""

    def read(self, truth: wp.array, tick: np.ndarray) -> np.ndarray:
        """Poses float64 [S, 7]; zeros where inactive."""
        assert len(tick) == len(self._active)
        return np.where(self._active[:, None], truth.numpy()[:, _COLUMNS], 0.0)
