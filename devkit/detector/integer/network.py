"""An integer network between pictures and raw heads, on a CPU or a GPU."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from devkit.detector.description import DetectorDescription
from devkit.detector.integer.map_kernels import picture_kernel
from devkit.detector.integer.network_file import read_network
from devkit.detector.integer.program import IntegerProgram
from devkit.detector.integer.shapes import LevelShape
from devkit.detector.integer.steps import IntegerHead, IntegerNetwork
from devkit.detector.network import Pictures, resized
from devkit.detector.resize import NetworkInput, prepare_kernels
from devkit.detector.runtime import ModelError
from devkit.images import Images, as_images

BATCH_CPU, BATCH_GPU = 4, 32
"""Images that are computed together, fewer if they are large: no bit depends on it."""

LEVELS_MAX = 1 << 30
"""Levels of all maps of a batch, of which a thread's number is 31 bits."""


def open_integer(
    path: Path, device: str
) -> tuple[DetectorDescription, HostIntegerNetwork | FrameIntegerNetwork]:
    """The network of a file. ``device``: as of :class:`devkit.detector.detector.Detector`.

    Raises:
        ModelError: the file is missing or damaged, or there is no such device; one line.
    """
    network, description, shapes = read_network(path)
    prepare_kernels()
    known = {name.output for name in network.steps if isinstance(name, IntegerHead)}
    for head in description.heads:
        if head.output not in known:
            raise ModelError(f"{path}: damaged: no step makes '{head.output}'")
    if device:
        return description, FrameIntegerNetwork(path, network, description, shapes, device)
    return description, HostIntegerNetwork(network, description, shapes)


class _Heads:
    """Sums of a program's heads -> real numbers."""

    def __init__(self, network: IntegerNetwork, shapes: list[LevelShape]) -> None:
        self._heads = {
            number: (step.output, np.frombuffer(step.scales, "<f8"), shapes[number].channels)
            for number, step in enumerate(network.steps, 1)
            if isinstance(step, IntegerHead)
        }
        self.outputs = [output for output, _, _ in self._heads.values()]
        self.numbers = list(self._heads)

    def values(self, number: int, sums: np.ndarray) -> tuple[str, np.ndarray]:
        """int32 [N, rows, columns, stored] -> name and float32 [N, channels, rows, columns]: one
        product and one rounding per number, the same everywhere."""
        output, scales, channels = self._heads[number]
        values = (sums[..., :channels] * scales).astype(np.float32)
        return output, np.ascontiguousarray(values.transpose(0, 3, 1, 2))


class HostIntegerNetwork:
    """On the CPU, with pictures of any sizes."""

    runtime = "integer cpu"

    def __init__(
        self, network: IntegerNetwork, description: DetectorDescription, shapes: list[LevelShape]
    ) -> None:
        """Allocate it."""
        self._description = description
        cpu = wp.get_device("cpu")
        picture = wp.zeros((BATCH_CPU, *shapes[0].stored_shape), dtype=wp.int8, device=cpu)
        self._program = IntegerProgram(network.steps, shapes, picture, None)
        self._levels: np.ndarray = picture.numpy()
        self._heads = _Heads(network, shapes)
        self.outputs = self._heads.outputs

    def heads(self, images: Pictures) -> dict[str, np.ndarray]:
        """See :class:`devkit.detector.network.LoadedNetwork`; sizes may differ."""
        pictures = list(images)
        parts = [
            self._run(pictures[first : first + BATCH_CPU])
            for first in range(0, max(len(pictures), 1), BATCH_CPU)
        ]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def _run(self, pictures: list[np.ndarray]) -> dict[str, np.ndarray]:
        for levels, picture in zip(self._levels, pictures, strict=False):
            # A level is the pixel less 128: the same bits but for the first.
            pixels = resized(picture, self._description)
            np.bitwise_xor(pixels, 0x80, out=levels[..., :3].view(np.uint8))
        count = len(pictures)
        self._program.run(count)
        arrays = {n: self._program.sums(n).numpy()[:count] for n in self._heads.numbers}
        return dict(self._heads.values(number, sums) for number, sums in arrays.items())


class _LevelInput(NetworkInput):
    """Pictures as levels, int8 [N, height, width, 4]."""

    def _target(self, batch: int, height: int, width: int) -> wp.array:
        return wp.zeros((batch, height, width, 4), dtype=wp.int8, device=self.device)

    def _kernel(self) -> wp.Kernel:
        return picture_kernel

    def _numbers(self) -> list[Any]:
        return [self._bgr]


class FrameIntegerNetwork:
    """On a GPU, or by the same path on the CPU, with pictures of one size where they lie."""

    def __init__(
        self,
        path: Path,
        network: IntegerNetwork,
        description: DetectorDescription,
        shapes: list[LevelShape],
        device: str,
    ) -> None:
        """Around ``network``, read from ``path``."""
        self._network, self._description, self._shapes = network, description, shapes
        self._device = device
        levels = sum(s.rows * s.columns * s.stored for s in shapes)
        self._batch = max(1, min(BATCH_GPU, LEVELS_MAX // levels))
        self._heads = _Heads(network, shapes)
        self._loaded: dict[tuple[int, int], tuple[_LevelInput, IntegerProgram, dict[int, Any]]] = {}
        self.outputs = self._heads.outputs
        self.runtime = f"integer {device.partition(':')[0]}"
        try:
            wp.get_device(device)
        except ValueError:
            raise ModelError(f"{path}: no device {device} here") from None

    def heads(self, images: Pictures) -> dict[str, np.ndarray]:
        """See :class:`devkit.detector.network.LoadedNetwork`; pictures of one size.

        Raises:
            ValueError: several sizes, or memory that holds no pictures.
        """
        if not len(images):
            size = (self._description.height, self._description.width)
            black = self.heads(np.zeros((1, *size, 3), np.uint8))
            return {name: array[:0] for name, array in black.items()}
        pictures = as_images(images)
        parts = [
            self._run(pictures, pictures.rows[first : first + self._batch])
            for first in range(0, len(pictures), self._batch)
        ]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def _run(self, images: Images, rows: Any) -> dict[str, np.ndarray]:
        entry, program, staged = self._opened(images.size_px)
        entry.fill(images, rows)
        program.run(len(rows))
        for sums in staged.values():
            sums.pull()
        entry.wait()
        count = len(rows)
        return dict(self._heads.values(n, sums.host[:count]) for n, sums in staged.items())

    def _opened(
        self, size_px: tuple[int, int]
    ) -> tuple[_LevelInput, IntegerProgram, dict[int, Any]]:
        if size_px not in self._loaded:
            entry = _LevelInput(self._description, size_px, self._batch, self._device)
            program = IntegerProgram(self._network.steps, self._shapes, entry.planes, entry.stream)
            staged = {n: entry.beside(program.sums(n)) for n in self._heads.numbers}
            self._loaded[size_px] = entry, program, staged
        return self._loaded[size_px]
