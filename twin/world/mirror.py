"""An array that lives on the host and on the device: one buffer on the CPU, two on a GPU."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from twin.base.gpu import cuda


class Mirror:
    """A NumPy array ``host`` and its Warp twin ``device``; allocated once.

    On the CPU both are the same memory and moving data costs nothing.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        dtype: Any,
        device: wp.Device,
        host: np.ndarray | None = None,
        *,
        large: bool = False,
    ) -> None:
        """``dtype`` is a Warp scalar, vector or struct type; the array starts as zeros.

        Vectors are further axes of the host array.

        Args:
            shape: of both.
            dtype: of the device's array.
            device: where it is computed with.
            host: memory that becomes the host array.
            large: worth copying at full speed (the host's pages are pinned) and sharing with
                another process (allocated outside Warp's pool, which has no handles).
        """
        inner = getattr(dtype, "_shape_", ())
        if hasattr(dtype, "numpy_dtype"):
            numpy_type = dtype.numpy_dtype()
        else:
            numpy_type = wp.dtype_to_numpy(getattr(dtype, "_wp_scalar_type_", dtype))
        self.host: np.ndarray = np.zeros((*shape, *inner), numpy_type) if host is None else host
        self._view = wp.array(
            ptr=self.host.ctypes.data, shape=shape, dtype=dtype, device="cpu", copy=False
        )
        self._shared = device.is_cpu
        if self._shared:
            self.device = self._view
        elif large:
            with wp.ScopedMempool(device, False):
                self.device = wp.zeros(shape, dtype=dtype, device=device)
            self._pages = cuda.pin(self.host, device.context)
        else:
            self.device = wp.zeros(shape, dtype=dtype, device=device)

    def push(self) -> None:
        """Host -> device."""
        if not self._shared and self.device.size:
            wp.copy(self.device, self._view)

    def pull(self) -> np.ndarray:
        """Device -> host; returns the host array."""
        if not self._shared and self.device.size:
            wp.copy(self._view, self.device)
            wp.synchronize_stream(self.device.device.stream)
        return self.host


def row_of(array: wp.array, slot: int) -> np.ndarray:
    """A copy of a slot's values of an array [S, ...] on a device."""
    row: np.ndarray = array[slot : slot + 1].numpy().copy()
    return row


def put_row(array: wp.array, slot: int, row: np.ndarray) -> None:
    """Write what :func:`row_of` gave into a slot."""
    count = array.size // array.shape[0]
    values = wp.array(row, dtype=array.dtype, device=array.device)
    wp.copy(array, values, dest_offset=slot * count, count=count)
