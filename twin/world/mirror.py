"""An array that lives on the host and on the device: one buffer on the CPU, two on a GPU."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp


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
    ) -> None:
        """``dtype`` is a Warp scalar, vector or struct type; the array starts as zeros.

        Vectors are further axes of the host array. ``host``: memory that becomes the host array.
        """
        inner = getattr(dtype, "_shape_", ())
        if hasattr(dtype, "numpy_dtype"):
            numpy_type = dtype.numpy_dtype()
        else:
            numpy_type = wp.dtype_to_numpy(getattr(dtype, "_wp_scalar_type_", dtype))
        self.host: np.ndarray = np.zeros((*shape, *inner), numpy_type) if host is None else host
        self._shared = device.is_cpu
        if self._shared:
            self.device = wp.array(
                ptr=self.host.ctypes.data, shape=shape, dtype=dtype, device=device, copy=False
            )
        else:
            self.device = wp.zeros(shape, dtype=dtype, device=device)

    def push(self) -> None:
        """Host -> device."""
        if not self._shared:
            self.device.assign(self.host)

    def pull(self) -> np.ndarray:
        """Device -> host; returns the host array."""
        if not self._shared:
            self.host[...] = self.device.numpy()
        return self.host
