"""The step from camera pictures to a network's input where the network runs, on a GPU or the CPU.

The resize is that of OpenCV's ``INTER_LINEAR_EXACT``, to the last bit: weights in 1/256 and whole
numbers throughout, whatever the device (``test_detector_frames.py`` compares the two). One Warp
kernel: of pictures in the GPU's memory only the indices travel. This module and
:mod:`devkit.detector.thin` are the only ones of the devkit that need Warp, imported by those who
look at pictures there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from devkit.detector.description import DetectorDescription
from devkit.images import Images, device_pointer
from twin.world.kernel_cache import prepare_kernels as prepare_kernels  # for others, too:
from twin.world.kernel_cache import wake as wake  # only here is this import allowed

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

ONE = 256
"""Weight of a whole pixel."""
_ONE = wp.constant(ONE)


def taps(given: int, wanted: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Source pixels of the pixels of a line.

    Args:
        given: pixels of the line.
        wanted: pixels of the resized line.

    Returns:
        Per resized pixel two indices, int64 [wanted], and the weight of the second, int64 [wanted],
        0 to :data:`ONE`; the first has the rest.
    """
    centre = (np.arange(wanted) + 0.5) * (given / wanted) - 0.5
    first = np.floor(centre).astype(np.int64)
    weight = np.rint((centre - first) * ONE).astype(np.int64)
    outside = (first < 0) | (first >= given - 1)
    first = np.clip(first, 0, given - 1)
    weight[outside] = 0
    return first, np.minimum(first + 1, given - 1), weight


@wp.func
def resized(
    across: wp.array2d(dtype=wp.int32),
    down: wp.array2d(dtype=wp.int32),
    pictures: wp.array4d(dtype=wp.uint8),
    row: wp.int32,
    y: wp.int32,
    x: wp.int32,
    k: wp.int32,
) -> wp.int32:
    """Channel ``k`` of pixel ``y``, ``x`` of a resized picture, 0 to 255, halves upwards.

    ``across`` [3, width] and ``down`` [3, height] are :func:`taps`.
    """
    left, right, rightness = across[0, x], across[1, x], across[2, x]
    upper, lower, lowness = down[0, y], down[1, y], down[2, y]
    a = wp.int32(pictures[row, upper, left, k]) * (_ONE - rightness)
    a += wp.int32(pictures[row, upper, right, k]) * rightness
    b = wp.int32(pictures[row, lower, left, k]) * (_ONE - rightness)
    b += wp.int32(pictures[row, lower, right, k]) * rightness
    mixed = a * (_ONE - lowness) + b * lowness
    return (mixed + _ONE * _ONE / 2) / (_ONE * _ONE)


@wp.kernel
def resize_kernel(
    # model
    across: wp.array2d(dtype=wp.int32),
    down: wp.array2d(dtype=wp.int32),
    scale: wp.float32,
    bgr: wp.int32,
    # state in
    pictures: wp.array4d(dtype=wp.uint8),
    rows: wp.array(dtype=wp.int32),
    # out
    planes: wp.array4d(dtype=wp.float32),
):
    """Pictures [S, H, W, 3], those of ``rows`` [N] -> planes [N, 3, height, width].

    ``across`` [3, width] and ``down`` [3, height] are :func:`taps`.
    """
    n, y, x = wp.tid()
    for channel in range(3):
        k = wp.where(bgr != 0, 2 - channel, channel)
        whole = resized(across, down, pictures, rows[n], y, x, k)
        planes[n, channel, y, x] = wp.float32(whole) * scale


class NetworkInput:
    """A network's input for ``batch`` pictures of one size, in the memory of its device."""

    def __init__(
        self, description: DetectorDescription, size_px: tuple[int, int], batch: int, device: str
    ) -> None:
        """Allocate the arrays. ``size_px``: width and height of the pictures; ``device``: ``cpu``
        or ``cuda:N``."""
        prepare_kernels()
        self.device = wp.get_device(device)
        self.stream = None if self.device.is_cpu else wp.Stream(self.device)
        """Stream in which its work is queued; networks of a GPU run side by side."""
        width, height = description.width, description.height
        self._across, self._down = (
            wp.array(np.stack(taps(extent, wanted)), dtype=wp.int32, device=self.device)
            for extent, wanted in zip(size_px, (width, height), strict=True)
        )
        self._scale = float(description.scale)
        self._bgr = int(description.channel_order == "bgr")
        self._size = (size_px[1], size_px[0], 3)
        self.planes = self._target(batch, height, width)
        self._rows = Staged((batch,), wp.int32, self)
        self._pictures: Staged | None = None
        wp.load_module(self._kernel().module.name, device=self.device)
        wp.synchronize_device(self.device)

    def _target(self, batch: int, height: int, width: int) -> wp.array:
        """Memory for what the network reads: float32 [N, 3, height, width]."""
        return wp.zeros((batch, 3, height, width), dtype=wp.float32, device=self.device)

    def _kernel(self) -> wp.Kernel:
        """What writes there."""
        return resize_kernel

    def _numbers(self) -> list[Any]:
        """The kernel's numbers: scale and order of the channels."""
        return [self._scale, self._bgr]

    @property
    def queue(self) -> int:
        """The stream as CUDA knows it; 0: none."""
        return 0 if self.stream is None else int(self.stream.cuda_stream)

    def wait(self) -> None:
        """Wait until the queued work is done."""
        if self.stream is not None:
            wp.synchronize_stream(self.stream)

    def head(self, shape: Sequence[int]) -> Staged:
        """Memory for an output of the network, float32."""
        return Staged(shape, wp.float32, self)

    def beside(self, array: wp.array) -> Staged:
        """A twin in the host's memory of an array on the device."""
        return Staged(array.shape, array.dtype, self, array)

    def fill(self, images: Images, rows: Sequence[int]) -> None:
        """Queue the pictures ``rows`` of ``images``, at most a batch. What fills the batch up
        matters to nobody: the first of them.

        Raises:
            ValueError: memory that holds no pictures.
        """
        if isinstance(images.array, np.ndarray):
            pictures, rows = self._brought(images.array, rows), range(len(rows))
        else:
            pointer, shape = device_pointer(images.array)
            pictures = wp.array(
                ptr=pointer, shape=shape, dtype=wp.uint8, device=self.device, copy=False
            )
        self._rows.host[:] = rows[0]
        self._rows.host[: len(rows)] = rows
        self._rows.push()
        across, down = self._across, self._down
        wp.launch(
            self._kernel(),
            (len(self._rows.host), down.shape[1], across.shape[1]),
            inputs=[across, down, *self._numbers(), pictures, self._rows.device],
            outputs=[self.planes],
            device=self.device,
            stream=self.stream,
        )

    def _brought(self, array: np.ndarray, rows: Sequence[int]) -> wp.array:
        """Some pictures of the host's memory."""
        if self._pictures is None:
            shape = (len(self._rows.host), *self._size)
            self._pictures = Staged(shape, wp.uint8, self)
        # With "clip", the only mode that writes into ``out`` at once.
        np.take(array, rows, axis=0, out=self._pictures.host[: len(rows)], mode="clip")
        self._pictures.push()
        return self._pictures.device


class Staged:
    """An array on a device and its pinned twin in the host's memory; one and the same on a CPU."""

    host: np.ndarray

    def __init__(
        self,
        shape: Sequence[int],
        dtype: Any,
        beside: NetworkInput,
        device: wp.array | None = None,
    ) -> None:
        """Copied in the stream of ``beside``; ``device``: the array there, if there is one."""
        self._stream = beside.stream
        gpu = self._stream is not None
        if device is not None and not gpu:
            self._twin = self.device = device
            self.host = device.numpy()
            return
        self._twin = wp.zeros(tuple(shape), dtype=dtype, device="cpu", pinned=gpu)
        self.host = self._twin.numpy()
        self.device = self._twin if device is None else device
        if gpu and device is None:
            self.device = wp.zeros(tuple(shape), dtype=dtype, device=beside.device)
            wp.synchronize_device(beside.device)  # it was made in another stream

    def push(self) -> None:
        """Queue the way to the device."""
        if self._stream is not None:
            wp.copy(self.device, self._twin, stream=self._stream)

    def pull(self) -> None:
        """Queue the way to the host."""
        if self._stream is not None:
            wp.copy(self._twin, self.device, stream=self._stream)
