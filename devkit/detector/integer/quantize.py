"""A float detector made into an integer network."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from devkit.detector.description import DetectorDescription
from devkit.detector.detector import check_input, described, read_model
from devkit.detector.integer.calibration import calibrated
from devkit.detector.integer.float_graph import (
    FloatConvolution,
    FloatJoin,
    FloatPool,
    FloatStep,
    FloatSum,
    GraphReader,
)
from devkit.detector.integer.levels import LevelScale, factor_of, kernel_levels
from devkit.detector.integer.shapes import map_shapes
from devkit.detector.integer.steps import (
    IntegerConvolution,
    IntegerHead,
    IntegerJoin,
    IntegerNetwork,
    IntegerPool,
    IntegerSum,
    JoinPart,
    Step,
)
from devkit.detector.network import resized
from devkit.detector.runtime import ModelError
from schemas.files.assets import file_digest

SUM_BITS = 29
"""Bits of the factors of a sum, which are two."""


def quantize(
    path: Path,
    pictures: Sequence[np.ndarray],
    description: DetectorDescription | None = None,
) -> IntegerNetwork:
    """The integer network of a float one.

    Args:
        path: an ONNX file.
        pictures: what it sees, to find the ranges of its maps; uint8 [H, W, 3], RGB.
        description: of a model whose metadata has none.

    Raises:
        ModelError: no picture, or something in the file that cannot be whole numbers; one line.
    """
    model = read_model(path)
    description = description or described(path, model)
    input_name, _ = check_input(path, model, description)
    steps = GraphReader(path, model).read(
        input_name, list(dict.fromkeys(head.output for head in description.heads))
    )
    tensors = [step.tensor for step in steps if _has_range(step)]
    scales = calibrated(path, model, input_name, tensors, _inputs(pictures, description))
    try:
        made = Quantizer(steps, scales, description.scale).made()
        network = IntegerNetwork(description.encode(), _origin(path, pictures), made)
        map_shapes(network, description)
    except ValueError as error:
        raise ModelError(f"{path}: {error}") from None
    return network


def _has_range(step: FloatStep) -> bool:
    """Whether a step's map needs a scale of its own."""
    return not isinstance(step, FloatPool) and not getattr(step, "output", "")


def _inputs(
    pictures: Sequence[np.ndarray], description: DetectorDescription
) -> Iterator[np.ndarray]:
    """Pictures as the float network reads them, float32 [3, height, width]."""
    for picture in pictures:
        planes = resized(picture, description).transpose(2, 0, 1)
        yield np.ascontiguousarray(planes) * np.float32(description.scale)


def _origin(path: Path, pictures: Sequence[np.ndarray]) -> str:
    """What a network is made of, for people."""
    seen = hashlib.sha256()
    for picture in pictures:
        seen.update(picture.tobytes())
    float_digest = file_digest(path)[:16]
    return (
        f"{path.name} (SHA-256 {float_digest}), calibrated with {len(pictures)} pictures"
        f" (SHA-256 {seen.hexdigest()[:16]})"
    )


class Quantizer:
    """Makes integer steps of float ones, map by map."""

    def __init__(
        self, steps: Sequence[FloatStep], scales: dict[str, LevelScale], picture_step: float
    ) -> None:
        """``scales``: by name of the tensor; ``picture_step``: factor of image levels."""
        self._steps = steps
        self._scales = [LevelScale(picture_step, -128)]
        self._given = scales

    def made(self) -> list[Step]:
        """The integer steps.

        Raises:
            ValueError: numbers of the network are too far apart; one line.
        """
        made = []
        for step in self._steps:
            if isinstance(step, FloatPool):
                scale = self._scales[step.given]
            elif isinstance(step, FloatConvolution) and step.output:
                scale = LevelScale(1.0, 0)
            else:
                scale = self._given[step.tensor]
            made.append(self._step(step, scale))
            self._scales.append(scale)
        return made

    def _step(self, step: FloatStep, scale: LevelScale) -> Step:
        if isinstance(step, FloatPool):
            return IntegerPool(step.given, step.windows)
        if isinstance(step, FloatSum):
            return self._sum(step, scale)
        if isinstance(step, FloatJoin):
            parts = []
            for view in step.parts:
                factor, shift = factor_of(self._scales[view.given].step / scale.step)
                parts.append(JoinPart(view.given, factor, shift, view.repeat, view.fold))
            return IntegerJoin(parts, scale.zero)
        return self._convolution(step, scale)

    def _sum(self, step: FloatSum, scale: LevelScale) -> IntegerSum:
        ratios = [self._scales[index].step / scale.step for index in (step.first, step.second)]
        _, shift = factor_of(max(ratios), SUM_BITS)
        factors = tuple(round(ratio * 2.0**shift) for ratio in ratios)
        return IntegerSum(step.first, step.second, (factors[0], factors[1]), shift, scale.zero)

    def _convolution(self, step: FloatConvolution, scale: LevelScale) -> Step:
        given = self._scales[step.given]
        kernels, steps = kernel_levels(step.kernels)
        units = given.step * steps
        biases = np.rint(step.biases / units) - given.zero * kernels.sum(axis=(1, 2, 3))
        if np.abs(biases).max() >= 2**31:
            raise ValueError(f"layer '{step.tensor}': a bias is too large beside its kernels")
        common: dict[str, Any] = {
            "given": step.given,
            "windows": step.windows,
            "outs": len(kernels),
            "kernels": kernels.transpose(0, 2, 3, 1).astype(np.int8).tobytes(),
            "biases": biases.astype("<i4").tobytes(),
        }
        if step.output:
            return IntegerHead(**common, scales=units.astype("<f8").tobytes(), output=step.output)
        pairs = [factor_of(float(unit) / scale.step) for unit in units]
        positive = np.array([factor for factor, _ in pairs])
        return IntegerConvolution(
            **common,
            positive=positive.astype("<i4").tobytes(),
            negative=np.rint(positive * step.slope).astype("<i4").tobytes(),
            shifts=np.array([shift for _, shift in pairs]).astype("i1").tobytes(),
            zero=scale.zero,
        )
