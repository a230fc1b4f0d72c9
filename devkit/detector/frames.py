"""A network that takes pictures where they lie, in batches of one size: for GPUs.

On CUDA a convolution gives an image other last bits at another batch size, and the same bits at one
batch size whatever its place and its neighbours (measured). So every batch is filled up to
:data:`MICRO_BATCH`, however many slots there are. Choosing pictures and resizing them is one kernel
(:mod:`devkit.detector.resize`), each of the first layers another (:mod:`devkit.detector.thin`);
what they write the rest of the network reads, and its heads come to the host through pinned memory,
all in one stream.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from devkit.detector.description import DetectorDescription
from devkit.detector.network import Pictures
from devkit.detector.resize import NetworkInput, Staged
from devkit.detector.runtime import open_session, provider_of, refusals
from devkit.detector.stem import cut
from devkit.detector.thin import ThinLayers
from devkit.images import Images, as_images

MICRO_BATCH = 32
"""Images that go through a network together, always: part of what a result depends on."""


@dataclass(frozen=True, slots=True)
class _Session:
    """The network for pictures of one size."""

    session: Any
    binding: Any
    entry: NetworkInput
    stem: ThinLayers
    heads: dict[str, Staged]


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
        own, 0 if that is free.

        Raises:
            ModelError: ONNX Runtime does not know such devices; one line.
        """
        provider_of(path, device)
        self._path = path
        self._model = model
        self._layers, self._rest, self._input = cut(model, input_name)
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
        """See :class:`devkit.detector.network.LoadedNetwork`; pictures of one size.

        Raises:
            ValueError: several sizes, or memory that holds no pictures.
        """
        if not len(images):
            size = (self._description.height, self._description.width)
            black = self.heads(np.zeros((1, *size, 3), np.uint8))
            return {name: array[:0] for name, array in black.items()}
        pictures = as_images(images)
        session = self._session(pictures.size_px)
        parts = []
        for first in range(0, len(pictures), self._batch):
            rows = pictures.rows[first : first + self._batch]
            parts.append(self._run(session, pictures, rows))
        return {name: np.concatenate([part[name] for part in parts]) for name in self._heads}

    def _run(self, session: _Session, images: Images, rows: Sequence[int]) -> dict[str, np.ndarray]:
        """Heads of at most a batch of pictures."""
        session.entry.fill(images, rows)
        session.stem.run()
        with refusals(self._path, "ONNX Runtime", self._model):
            session.session.run_with_iobinding(session.binding)
        for head in session.heads.values():
            head.pull()
        session.entry.wait()
        return {name: head.host[: len(rows)].copy() for name, head in session.heads.items()}

    def _session(self, size_px: tuple[int, int]) -> _Session:
        session = self._sessions.get(size_px)
        if session is None:
            session = self._sessions[size_px] = self._opened(size_px)
        return session

    def _opened(self, size_px: tuple[int, int]) -> _Session:
        with refusals(self._path, "Warp", self._model):
            entry = NetworkInput(self._description, size_px, self._batch, self._device)
            stem = ThinLayers(self._layers, entry.planes, entry.stream)
        session = open_session(self._path, self._rest, self._device, entry.queue)
        binding = session.io_binding()
        there = (self._kind, self._index, np.float32)
        binding.bind_input(self._input, *there, list(stem.out.shape), stem.out.ptr)
        heads = {}
        for name, shape in self._shapes(session, binding).items():
            heads[name] = entry.head(shape)
            binding.bind_output(name, *there, shape, heads[name].device.ptr)
        return _Session(session, binding, entry, stem, heads)

    def _shapes(self, session: Any, binding: Any) -> dict[str, list[int]]:
        """What the network makes of a batch that is black: files need not say it."""
        for name in self._heads:
            binding.bind_output(name, "cpu")
        with refusals(self._path, "ONNX Runtime", self._model):
            session.run_with_iobinding(binding)
            arrays = binding.copy_outputs_to_cpu()
        binding.clear_binding_outputs()
        return {name: list(array.shape) for name, array in zip(self._heads, arrays, strict=True)}
