"""A detector: an ONNX file run on the CPU, by OpenCV or by ONNX Runtime.

A model is checked completely when it is loaded, with one black image through all of it: what can
be wrong with a file is said then, in one line, and not in the middle of a case.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from devkit.detector_decode import Detections, Selection, decode
from devkit.detector_description import (
    METADATA_KEY,
    BoxHead,
    DetectorDescription,
    GridHead,
    decode_description,
)
from devkit.detector_runtime import ModelError, RuntimeName, first_line, open_runtime
from schemas.validation import suggest

BATCH_MAX = 16
"""Images that go through the network together; more do so in turns."""

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
    ) -> None:
        """Load and check a model.

        Args:
            path: ONNX file.
            selection: which boxes are reported.
            description: of a model whose metadata has none; wins over the metadata.
            runtime: what runs it, see :mod:`devkit.detector_runtime`.

        Raises:
            ModelError: the file is missing, damaged, no detector of this kind, or needs something
                that the runtime does not have; one line naming the file.
        """
        self.path = path
        self.selection = selection or Selection()
        model = _read_model(path)
        self.description = description or _described(path, model)
        self._input, self._batch = _check_input(path, model, self.description)
        self._runtime = open_runtime(runtime, path, model, self._input)
        self._check_heads()

    def detect(self, images: Sequence[np.ndarray] | np.ndarray) -> Detections:
        """Boxes of N images, uint8 [N, H, W, 3] or a sequence of [H, W, 3], RGB.

        Raises:
            ValueError: an image of another type or shape.
        """
        for image in images:
            if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
                raise ValueError(
                    f"image: given {image.dtype} {list(image.shape)}, expected uint8 [H, W, 3], RGB"
                )
        sizes_px = [(image.shape[1], image.shape[0]) for image in images]
        return decode(self.raw(images), self.description, sizes_px, self.selection)

    def raw(self, images: Sequence[np.ndarray] | np.ndarray) -> dict[str, np.ndarray]:
        """Raw heads of N images: name -> float32 [N, ...], see
        :mod:`devkit.detector_description`."""
        batch = self._batch or BATCH_MAX
        parts = [
            self._forward(np.stack([self._prepared(i) for i in images[first : first + batch]]))
            for first in range(0, len(images), batch)
        ]
        if not parts:
            parts = [{k: v[:0] for k, v in self._forward(self._black()).items()}]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def _prepared(self, image: np.ndarray) -> np.ndarray:
        """uint8 [H, W, 3] -> float32 [3, height, width]: stretched to the network's size."""
        size = (self.description.width, self.description.height)
        if (image.shape[1], image.shape[0]) != size:
            # The bit-exact variant is integer arithmetic: the same on any machine.
            image = cv2.resize(image, size, interpolation=cv2.INTER_LINEAR_EXACT)
        if self.description.channel_order == "bgr":
            image = image[..., ::-1]
        planes = np.ascontiguousarray(image.transpose(2, 0, 1))
        return planes * np.float32(self.description.scale)

    def _forward(self, blob: np.ndarray) -> dict[str, np.ndarray]:
        count = len(blob)
        if self._batch and count < self._batch:
            blob = np.concatenate([blob, np.repeat(self._black(), self._batch - count, axis=0)])
        found = self._runtime.forward(blob)
        return {head.output: found[head.output][:count] for head in self.description.heads}

    def _black(self) -> np.ndarray:
        return np.zeros((1, 3, self.description.height, self.description.width), np.float32)

    def _check_heads(self) -> None:
        for head in self.description.heads:
            known = self._runtime.outputs
            if head.output not in known:
                raise ModelError(
                    f"{self.path}: no output '{head.output}'; {suggest(head.output, known)}"
                )
        outputs = self._forward(self._black())
        for head in self.description.heads:
            shape = outputs[head.output].shape
            mistake = _head_mistake(head, shape, len(self.description.names))
            if mistake:
                raise ModelError(
                    f"{self.path}: output '{head.output}' is {list(shape)}, expected {mistake}"
                )


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


def _read_model(path: Path) -> Any:
    """The file as ``onnx.ModelProto``."""
    import onnx
    from google.protobuf.message import DecodeError

    try:
        size = path.stat().st_size
        if size > MODEL_BYTES_MAX:
            raise ModelError(f"{path}: {size} bytes, an ONNX file has at most {MODEL_BYTES_MAX}")
        data = path.read_bytes()
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror or error}") from None
    try:
        model = onnx.load_model_from_string(data)
        onnx.checker.check_model(model)
    except (DecodeError, onnx.checker.ValidationError) as error:
        reason = first_line(error)
        raise ModelError(f"{path}: not an ONNX file, or damaged: {reason}") from None
    return model


def _described(path: Path, model: Any) -> DetectorDescription:
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


def _check_input(path: Path, model: Any, description: DetectorDescription) -> tuple[str, int]:
    """Name of the input and its batch size, 0 if that is free."""
    constants = {tensor.name for tensor in model.graph.initializer}
    inputs = [value for value in model.graph.input if value.name not in constants]
    if len(inputs) != 1:
        names = ", ".join(value.name for value in inputs) or "none"
        raise ModelError(f"{path}: inputs {names}, expected one, the images")
    kind = inputs[0].type.tensor_type
    found = [d.dim_value or d.dim_param or "?" for d in kind.shape.dim]
    expected = ["batch", 3, description.height, description.width]
    fits = len(found) == 4 and all(
        not isinstance(given, int) or given == needed
        for given, needed in zip(found[1:], expected[1:], strict=True)
    )
    if not fits:
        shown, wanted = (", ".join(map(str, shape)) for shape in (found, expected))
        raise ModelError(
            f"{path}: input '{inputs[0].name}' is [{shown}], expected [{wanted}]:"
            " images of three channels at the described width and height"
        )
    if kind.elem_type != 1:
        raise ModelError(f"{path}: input '{inputs[0].name}' is not float32")
    return inputs[0].name, found[0] if isinstance(found[0], int) else 0
