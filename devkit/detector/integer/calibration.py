"""What the maps of a float network hold when it sees real pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from devkit.detector.integer.levels import LevelScale, scale_of
from devkit.detector.runtime import ModelError, open_runtime

SAMPLES = 1 << 16
"""Values of a map that are kept of all pictures together."""


VALUE_MAX = 1e30
"""Magnitude from which on a value counts as infinite, for which OpenCV puts the largest float."""


class _Values:
    """Least and largest value of a map, and some of those between."""

    def __init__(self, per_picture: int, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._per_picture = per_picture
        self._kept: list[np.ndarray] = []
        self._least, self._largest = np.inf, -np.inf

    def add(self, values: np.ndarray) -> None:
        flat = values.reshape(-1)
        self._least = min(self._least, float(flat.min()))
        self._largest = max(self._largest, float(flat.max()))
        self._kept.append(flat[self._rng.integers(0, len(flat), self._per_picture)])

    def scale(self) -> LevelScale:
        return scale_of(np.concatenate(self._kept), self._least, self._largest)


def calibrated(
    path: Path,
    model: Any,
    input_name: str,
    tensors: Sequence[str],
    pictures: Iterable[np.ndarray],
) -> dict[str, LevelScale]:
    """Scales of the named tensors.

    Args:
        path: where ``model``, an ``onnx.ModelProto``, was read.
        model: the float network.
        input_name: of its only input.
        tensors: names in the ONNX file.
        pictures: prepared for the network, float32 [3, height, width].

    Raises:
        ModelError: no picture, or a tensor that is not finite; one line.
    """
    import onnx

    watched = onnx.shape_inference.infer_shapes(model)
    shapes = {value.name: value for value in watched.graph.value_info}
    del watched.graph.output[:]
    watched.graph.output.extend(shapes[tensor] for tensor in tensors)
    opened = open_runtime("opencv", path, watched, input_name)
    inputs = list(pictures)
    if not inputs:
        raise ModelError(f"{path}: no picture to calibrate with")
    per_picture = max(1, SAMPLES // len(inputs))
    values = {tensor: _Values(per_picture, seed) for seed, tensor in enumerate(tensors)}
    for picture in inputs:
        arrays = opened.forward(picture[None])
        for tensor in tensors:
            if not np.abs(arrays[tensor]).max() < VALUE_MAX:  # nor is NaN
                raise ModelError(f"{path}: '{tensor}' is not finite for a picture")
            values[tensor].add(arrays[tensor])
    return {tensor: one.scale() for tensor, one in values.items()}
