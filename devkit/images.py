"""Pictures of one size that lie in one array, in this host's memory or in a GPU's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True, eq=False)
class Images:
    """Rows of an array of pictures, in an order of one's own: no picture is copied for it."""

    array: Any
    """uint8 [S, H, W, 3], RGB, contiguous: a NumPy array, or an object in a GPU's memory with
    ``__cuda_array_interface__``. Whoever wrote to such memory has waited until it was written."""
    rows: Sequence[int]
    """Indices of the pictures along the first axis."""

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[np.ndarray]:
        return (self[index] for index in range(len(self)))

    def __getitem__(self, index: int) -> np.ndarray:
        """Picture ``index``, uint8 [H, W, 3]; a view.

        Raises:
            ValueError: the pictures are not in this host's memory, and cannot be brought there.
        """
        picture: np.ndarray = on_host(self.array)[self.rows[index]]
        return picture

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of every picture [px]."""
        _, height, width, _ = self.array.shape
        return width, height


def on_host(array: Any) -> np.ndarray:
    """The pictures in this host's memory; those of a simulator's GPU are copied once per frame.

    Raises:
        ValueError: they cannot be brought there.
    """
    if isinstance(array, np.ndarray):
        return array
    if not hasattr(array, "host"):
        raise ValueError("the pictures lie in a GPU's memory; this needs them in the host's")
    pictures: np.ndarray = array.host()
    return pictures


def as_images(images: Sequence[np.ndarray] | np.ndarray | Images) -> Images:
    """Pictures that are not in one array yet, brought into one.

    Raises:
        ValueError: they are not uint8 [H, W, 3] of one size.
    """
    if isinstance(images, Images):
        return images
    sizes = {(image.dtype.name, *image.shape) for image in images}
    if len(sizes) > 1:
        raise ValueError("images of several sizes; give those of one size together")
    array = images if isinstance(images, np.ndarray) else np.stack(list(images))
    return Images(array, range(len(array)))


def device_pointer(array: Any) -> tuple[int, tuple[int, ...]]:
    """Address and shape of pictures in a GPU's memory.

    Raises:
        ValueError: not uint8 [S, H, W, 3], or not contiguous.
    """
    interface = array.__cuda_array_interface__
    shape = tuple(int(extent) for extent in interface["shape"])
    strides = interface.get("strides")
    contiguous = strides is None or tuple(strides) == tuple(
        int(np.prod(shape[axis + 1 :])) for axis in range(len(shape))
    )
    if interface["typestr"] != "|u1" or len(shape) != 4 or shape[3] != 3 or not contiguous:
        raise ValueError(
            f"pictures on a GPU: given {interface['typestr']} {list(shape)}, expected contiguous"
            " uint8 [S, H, W, 3], RGB"
        )
    return int(interface["data"][0]), shape
