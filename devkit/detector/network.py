"""A loaded network between pictures and raw heads, with pictures in the host's memory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import cv2
import numpy as np

from devkit.detector.description import DetectorDescription
from devkit.detector.runtime import Runtime
from devkit.images import Images

BATCH_MAX = 16
"""Images that go through the network together; more do so in turns."""

Pictures = Sequence[np.ndarray] | np.ndarray | Images
"""N pictures, uint8 [H, W, 3], RGB."""


class LoadedNetwork(Protocol):
    """Pictures in, raw heads out; every picture's are the same to the last bit whatever pictures
    are beside it."""

    outputs: list[str]
    """Names of all outputs."""
    runtime: str
    """The library and device that run the network, for people."""

    def heads(self, images: Pictures) -> dict[str, np.ndarray]:
        """Name -> float32 [N, ...], see :mod:`devkit.detector.description`."""
        ...


def resized(image: np.ndarray, description: DetectorDescription) -> np.ndarray:
    """A picture, uint8 [H, W, 3], RGB, stretched to the network's size, in its order of
    channels."""
    size = (description.width, description.height)
    if (image.shape[1], image.shape[0]) != size:
        # The bit-exact variant is integer arithmetic: the same on any machine.
        image = cv2.resize(image, size, interpolation=cv2.INTER_LINEAR_EXACT)
    return image[..., ::-1] if description.channel_order == "bgr" else image


class HostNetwork:
    """Resizes on the CPU, in batches of any size."""

    def __init__(self, description: DetectorDescription, runtime: Runtime, batch: int) -> None:
        """Around a loaded ``runtime``; ``batch`` is the network's, 0 if that is free."""
        self._description = description
        self._runtime = runtime
        self._batch = batch
        self.outputs = runtime.outputs
        self.runtime = f"{runtime.name} cpu"

    def heads(self, images: Pictures) -> dict[str, np.ndarray]:
        """See :class:`LoadedNetwork`; sizes may differ."""
        batch = self._batch or BATCH_MAX
        prepared = [self._prepared(image) for image in images]
        parts = [
            self._forward(np.stack(prepared[first : first + batch]))
            for first in range(0, len(prepared), batch)
        ]
        if not parts:
            parts = [{k: v[:0] for k, v in self._forward(self._black()).items()}]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def _prepared(self, image: np.ndarray) -> np.ndarray:
        """uint8 [H, W, 3] -> float32 [3, height, width]: stretched to the network's size."""
        planes = np.ascontiguousarray(resized(image, self._description).transpose(2, 0, 1))
        return planes * np.float32(self._description.scale)

    def _forward(self, blob: np.ndarray) -> dict[str, np.ndarray]:
        count = len(blob)
        if self._batch and count < self._batch:
            blob = np.concatenate([blob, np.repeat(self._black(), self._batch - count, axis=0)])
        return {name: array[:count] for name, array in self._runtime.forward(blob).items()}

    def _black(self) -> np.ndarray:
        return np.zeros((1, 3, self._description.height, self._description.width), np.float32)
