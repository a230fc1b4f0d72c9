"""A network that takes pictures where they lie, in batches of one size: for GPUs.

On CUDA a convolution gives an image other last bits at another batch size, and the same bits at one
batch size whatever its place and its neighbours (measured). So every batch is filled up to
:data:`MICRO_BATCH`, however many slots there are. Choosing pictures, resizing and the network are
one graph (:mod:`devkit.detector_resize`): of pictures in the GPU's memory only the indices travel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from devkit.detector_description import DetectorDescription
from devkit.detector_network import Pictures
from devkit.detector_resize import FRAMES, ROWS, with_frames
from devkit.detector_runtime import open_session, refusals
from devkit.images import Images, as_images, device_pointer

MICRO_BATCH = 32
"""Images that go through a network together, always: part of what a result depends on."""


@dataclass(slots=True)
class _Session:
    """The graph for pictures of one size."""

    session: Any
    binding: Any
    rows: np.ndarray
    """int64 [batch]: read by the binding at every run."""
    pictures: np.ndarray | None = None
    """Likewise, while they are on the host: the binding does not keep them."""


class FrameNetwork:
    """ONNX Runtime on ``cuda:N``, or on ``cpu`` to try the same path there."""

    def __init__(
        self,
        path: Path,
        model: Any,
        input_name: str,
        batch: int,
        description: DetectorDescription,
        device: str,
    ) -> None:
        """Around ``model``, an ``onnx.ModelProto`` that was read from ``path``; ``batch`` is its
        own, 0 if that is free."""
        self._path = path
        self._model = model
        self._input = input_name
        self._batch = batch or MICRO_BATCH
        self._description = description
        self._device = device
        self._kind, _, index = device.partition(":")
        self._index = int(index or 0)
        self._sessions: dict[tuple[int, int], _Session] = {}
        self._heads = list(dict.fromkeys(head.output for head in description.heads))
        self.outputs = [output.name for output in model.graph.output]
        self.runtime = f"onnxruntime {self._kind}"

    def heads(self, images: Pictures) -> dict[str, np.ndarray]:
        """See :class:`devkit.detector_network.Network`; pictures of one size.

        Raises:
            ValueError: several sizes, or memory that holds no pictures.
        """
        if not len(images):
            size = (self._description.height, self._description.width)
            black = self.heads(np.zeros((1, *size, 3), np.uint8))
            return {name: array[:0] for name, array in black.items()}
        given = as_images(images)
        session = self._session(given.size_px)
        parts = []
        for first in range(0, len(given), self._batch):
            rows = given.rows[first : first + self._batch]
            self._place(session, given, rows)
            with refusals(self._path, "ONNX Runtime", self._model):
                session.session.run_with_iobinding(session.binding)
                arrays = session.binding.copy_outputs_to_cpu()
            parts.append([array[: len(rows)] for array in arrays])
        joined = [np.concatenate(column) for column in zip(*parts, strict=True)]
        return dict(zip(self._heads, joined, strict=True))

    def _place(self, session: _Session, images: Images, rows: Sequence[int]) -> None:
        """Say where the pictures lie. What fills the batch up matters to nobody: the first."""
        session.rows[:] = 0 if isinstance(images.array, np.ndarray) else rows[0]
        if isinstance(images.array, np.ndarray):
            # Only these travel to the device; ONNX Runtime brings them there.
            session.rows[: len(rows)] = range(len(rows))
            session.pictures = _taken(images.array, rows)
            session.binding.bind_cpu_input(FRAMES, session.pictures)
        else:
            pointer, shape = device_pointer(images.array)
            session.rows[: len(rows)] = rows
            session.binding.bind_input(
                FRAMES, self._kind, self._index, np.uint8, list(shape), pointer
            )
        session.binding.bind_cpu_input(ROWS, session.rows)

    def _session(self, size_px: tuple[int, int]) -> _Session:
        found = self._sessions.get(size_px)
        if found is None:
            found = self._sessions[size_px] = self._opened(size_px)
        return found

    def _opened(self, size_px: tuple[int, int]) -> _Session:
        model = with_frames(self._model, self._input, self._description, size_px)
        session = open_session(self._path, model, self._device)
        binding = session.io_binding()
        for name in self._heads:
            binding.bind_output(name, "cpu")
        return _Session(session, binding, np.zeros(self._batch, np.int64))


def _taken(array: np.ndarray, rows: Sequence[int]) -> np.ndarray:
    """Some pictures of an array, contiguous; not copied where they lie side by side."""
    first = rows[0]
    if list(rows) == list(range(first, first + len(rows))):
        return np.ascontiguousarray(array[first : first + len(rows)])
    return array[list(rows)]
