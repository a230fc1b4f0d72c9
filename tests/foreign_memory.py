"""Arrays in memory that a test may only know by its address."""

from __future__ import annotations

import numpy as np


class Elsewhere:
    """Memory of which nothing is known but its interface, as of a GPU."""

    def __init__(self, array: np.ndarray) -> None:
        self._array = array
        self.shape = array.shape
        self.__cuda_array_interface__ = {
            "shape": array.shape,
            "typestr": array.dtype.str,
            "data": (array.ctypes.data, False),
            "strides": None,
            "version": 3,
        }
