"""Readings that a sensor gives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import warp as wp

from twin.world.mirror import Mirror


class SensorData:
    """One sensor's values for all slots; inactive slots hold zeros."""

    __slots__ = ("_pull", "_values", "count", "device")

    def __init__(
        self,
        values: np.ndarray | Callable[[], np.ndarray],
        count: np.ndarray | None = None,
        device: wp.array | None = None,
    ) -> None:
        """Hold readings, or what brings them.

        Args:
            values: [S, ...], or what brings them to the host; asked once, when somebody looks.
            count: int32 [S]: valid rows of ragged data.
            device: the same values in a GPU's memory.
        """
        self._values = values if isinstance(values, np.ndarray) else None
        self._pull = None if isinstance(values, np.ndarray) else values
        self.count = count
        self.device = device

    @classmethod
    def mirrored(cls, mirror: Mirror, count: np.ndarray | None = None) -> SensorData:
        """Values of a mirror: they stay on a GPU until the host asks for them."""
        return cls(mirror.pull, count, None if mirror.device.device.is_cpu else mirror.device)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the values; nothing is brought to the host for it."""
        if self.device is None:
            return self.values.shape
        return tuple(self.device.__cuda_array_interface__["shape"])

    def of(self, slot: int) -> np.ndarray:
        """Copy of one slot's values; nothing of the others is brought to the host for it."""
        if self._values is None and self.device is not None:
            return np.array(self.device[slot].numpy())
        return self.values[slot].copy()

    @property
    def values(self) -> np.ndarray:
        """[S, ...] on the host; valid until the next call of the engine."""
        if self._values is None:
            assert self._pull is not None
            self._values = self._pull()
        return self._values
