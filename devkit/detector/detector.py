"""A detector: an ONNX file run on the CPU, by OpenCV or by ONNX Runtime, or on a GPU; or an integer
network, which kernels of ours run on both.

A model is checked completely when it is loaded, with one black image through all of it: what can
be wrong with a file is said then, in one line, and not in the middle of a case.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from devkit.detector.decode import DetectionBatch, Selection, decode
from devkit.detector.description import (
    METADATA_KEY,
    BoxHead,
    DetectorDescription,
    GridHead,
    decode_description,
)
from devkit.detector.network import HostNetwork, LoadedNetwork, Pictures
from devkit.detector.runtime import ModelError, RuntimeName, first_line, open_runtime
from devkit.images import Images
from schemas.files.regular_file import read_regular
from schemas.validation import suggest

INTEGER_SUFFIX = ".integer"
"""Ending of files of integer networks, :mod:`devkit.detector.integer`."""

MODEL_BYTES_MAX = 2 << 30
"""A larger model does not fit into one ONNX file [bytes]."""


class Detector:
    """A network with its decoding. Results of an image do not depend on the batch it is in, nor on
    the number of threads; they do on the runtime, by rounding."""

    def __init__(
        self,
        path: Path,
        selection: Selection | None = None,
        description: DetectorDescription | None = None,
        runtime: RuntimeName = "opencv",
        *,
        device: str = "",
        size_px: tuple[int, int] | None = None,
        model: Any = None,
    ) -> None:
        """Load and check a model.

        Args:
            path: ONNX file, or an integer network, which runs in its own way whatever ``runtime``.
            selection: which boxes are reported.
            description: of a model whose metadata has none; wins over the metadata.
            runtime: what runs it, see :mod:`devkit.detector.runtime`.
            device: ``cuda:N``: ONNX Runtime takes pictures of one size on that GPU
                (:mod:`devkit.detector.frames`); ``cpu``: the same on the CPU, to try it; empty:
                pictures of any size on the CPU.
            size_px: width and height of the pictures that will come, with a device: the check is
                made with such a picture [px].
            model: ``onnx.ModelProto`` that ``path`` was made to; None: ``path`` is read.

        Raises:
            ModelError: the file is missing, damaged, no detector of this kind, or needs something
                that the runtime does not have; one line naming the file.
        """
        self.path = path
        self.selection = selection or Selection()
        # Several variants may select from one network, and look at the same time.
        self._turn = threading.Lock()
        self._network: LoadedNetwork
        if path.suffix == INTEGER_SUFFIX:
            # Needs Warp, which the others do without.
            from devkit.detector.integer.network import open_integer

            self.description, self._network = open_integer(path, device)
        else:
            self.description, self._network = _opened(path, description, runtime, device, model)
        self._check_heads(size_px or (self.description.width, self.description.height))

    @property
    def runtime(self) -> str:
        """The library and device that run the network, for people: ``opencv cpu``."""
        return self._network.runtime

    def detect(self, images: Pictures, selection: Selection | None = None) -> DetectionBatch:
        """Boxes of N images, uint8 [N, H, W, 3], a sequence of [H, W, 3], or
        :class:`devkit.images.Images`; RGB.

        Args:
            images: of any sizes; of one size if the detector was made for a device.
            selection: other boxes than the detector's own.

        Raises:
            ValueError: an image of another type or shape.
        """
        if isinstance(images, Images):
            sizes_px = [images.size_px] * len(images)
        else:
            for image in images:
                if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
                    raise ValueError(
                        f"image: given {image.dtype} {list(image.shape)},"
                        " expected uint8 [H, W, 3], RGB"
                    )
            sizes_px = [(image.shape[1], image.shape[0]) for image in images]
        return decode(self.raw(images), self.description, sizes_px, selection or self.selection)

    def raw(self, images: Pictures) -> dict[str, np.ndarray]:
        """Raw heads of N images: name -> float32 [N, ...], see
        :mod:`devkit.detector.description`."""
        with self._turn:
            outputs = self._network.heads(images)
        return {head.output: outputs[head.output] for head in self.description.heads}

    def _check_heads(self, size_px: tuple[int, int]) -> None:
        for head in self.description.heads:
            known = self._network.outputs
            if head.output not in known:
                raise ModelError(
                    f"{self.path}: no output '{head.output}'; {suggest(head.output, known)}"
                )
        outputs = self.raw(np.zeros((1, size_px[1], size_px[0], 3), np.uint8))
        for head in self.description.heads:
            shape = outputs[head.output].shape
            mistake = _head_mistake(head, shape, len(self.description.names))
            if mistake:
                raise ModelError(
                    f"{self.path}: output '{head.output}' is {list(shape)}, expected {mistake}"
                )


def _opened(
    path: Path,
    description: DetectorDescription | None,
    runtime: RuntimeName,
    device: str,
    model: Any,
) -> tuple[DetectorDescription, LoadedNetwork]:
    """The network of an ONNX file; arguments as :class:`Detector` has them."""
    if model is None:
        model = read_model(path)
    description = description or described(path, model)
    name, batch = check_input(path, model, description)
    if not device:
        loaded = open_runtime(runtime, path, model, name)
        return description, HostNetwork(description, loaded, batch)
    if runtime != "onnxruntime":
        raise ModelError(f"{path}: runtime '{runtime}' on {device}, allowed: onnxruntime")
    # Needs Warp, which the others do without.
    from devkit.detector.frames import FrameNetwork

    return description, FrameNetwork(path, model, name, batch, description, device)


def _head_mistake(head: GridHead | BoxHead, shape: Sequence[int], classes: int) -> str:
    """The shape that an output should have, and why; empty if it has it."""
    channels = head.channels(classes)
    if isinstance(head, GridHead):
        axis, rank, dimensions = 1, 4, f"{channels}, rows, columns"
        why = f"{len(head.anchors_px)} anchors x (5 + {classes} classes)"
    else:
        rows = head.layout == "rows"
        axis, rank = (2, 3) if rows else (1, 3)
        dimensions = f"boxes, {channels}" if rows else f"{channels}, boxes"
        why = f"4 for the box{' + objectness' * head.objectness} + {classes} classes"
    fits = len(shape) == rank and shape[axis] == channels
    return "" if fits else f"[batch, {dimensions}]: {why}"


def read_model(path: Path) -> Any:
    """The file as ``onnx.ModelProto``."""
    import onnx
    from google.protobuf.message import DecodeError

    try:
        data = read_regular(path, MODEL_BYTES_MAX)
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror or error}") from None
    try:
        model = onnx.load_model_from_string(data)
        if any(tensor.data_location for tensor in model.graph.initializer):
            raise ModelError(f"{path}: its numbers lie in another file; save it as one file")
        onnx.checker.check_model(model)
    except (DecodeError, UnicodeDecodeError, onnx.checker.ValidationError) as error:
        reason = first_line(error)
        raise ModelError(f"{path}: not an ONNX file, or damaged: {reason}") from None
    return model


def described(path: Path, model: Any) -> DetectorDescription:
    """What the model's metadata say."""
    for entry in model.metadata_props:
        if entry.key == METADATA_KEY:
            try:
                return decode_description(entry.value, f"{path}: metadata '{METADATA_KEY}'")
            except ValueError as error:
                raise ModelError(str(error)) from None
    raise ModelError(
        f"{path}: no metadata '{METADATA_KEY}', so width, height, names and heads must be"
        " given with the model, as a description"
    )


def check_input(path: Path, model: Any, description: DetectorDescription) -> tuple[str, int]:
    """Name of the input and its batch size, 0 if that is free."""
    constants = {tensor.name for tensor in model.graph.initializer}
    inputs = [value for value in model.graph.input if value.name not in constants]
    if len(inputs) != 1:
        names = ", ".join(value.name for value in inputs) or "none"
        raise ModelError(f"{path}: inputs {names}, expected one, the images")
    kind = inputs[0].type.tensor_type
    dimensions = [d.dim_value or d.dim_param or "?" for d in kind.shape.dim]
    expected = ["batch", 3, description.height, description.width]
    fits = len(dimensions) == 4 and all(
        not isinstance(extent, int) or extent == needed
        for extent, needed in zip(dimensions[1:], expected[1:], strict=True)
    )
    if not fits:
        shown, wanted = (", ".join(map(str, shape)) for shape in (dimensions, expected))
        raise ModelError(
            f"{path}: input '{inputs[0].name}' is [{shown}], expected [{wanted}]:"
            " images of three channels at the described width and height"
        )
    if kind.elem_type != 1:
        raise ModelError(f"{path}: input '{inputs[0].name}' is not float32")
    return inputs[0].name, dimensions[0] if isinstance(dimensions[0], int) else 0
