"""Small integer networks for tests."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import onnx
from darknet_oracle import random_weights

from devkit.darknet.onnx_writer import write_onnx
from devkit.darknet.variant import architecture_network
from devkit.detector.description import DetectorDescription, GridHead
from devkit.detector.integer.network_file import encode_network
from devkit.detector.integer.quantize import quantize
from devkit.detector.integer.steps import (
    IntegerConvolution,
    IntegerHead,
    IntegerNetwork,
    Step,
    Windows,
)

NAMES = ["car", "truck", "pedestrian", "traffic_sign"]
PLAIN = Windows(3, 1, (1, 1, 1, 1))
WHOLE = Windows(1, 1, (0, 0, 0, 0))


def pictures(count: int, width: int = 160, height: int = 96, seed: int = 1) -> np.ndarray:
    """Random blocks, uint8 [count, height, width, 3]."""
    rng = np.random.default_rng(seed)
    blocks = rng.integers(0, 256, (count, -(-height // 8), -(-width // 8), 3), dtype=np.uint8)
    return blocks.repeat(8, axis=1).repeat(8, axis=2)[:, :height, :width].copy()


def write_float(path: Path, name: str, width: int = 160, height: int = 96) -> Path:
    """A published architecture at a quarter of its width with random weights, as ONNX."""
    network = architecture_network(f"{name}-w25", classes=4, width=width, height=height)
    onnx.save(write_onnx(network, random_weights(network, 11), NAMES), path)
    return path


@cache
def described(width: int = 8, height: int = 8) -> DetectorDescription:
    """One head of one anchor and one class."""
    return DetectorDescription(width, height, ["car"], [GridHead("head", [(4.0, 4.0)])])


def head(given: int, channels: int, outs: int = 6, output: str = "head") -> IntegerHead:
    """A head of one pixel."""
    rng = np.random.default_rng(outs)
    kernels = rng.integers(-127, 128, (outs, 1, 1, channels), dtype=np.int8)
    return IntegerHead(
        given, WHOLE, outs, kernels.tobytes(), bytes(4 * outs), np.ones(outs).tobytes(), output
    )


def convolution(
    given: int,
    channels: int,
    outs: int,
    windows: Windows = PLAIN,
    *,
    seed: int = 0,
    kernels: np.ndarray | None = None,
) -> IntegerConvolution:
    """Random kernels and factors that use the whole range of levels."""
    rng = np.random.default_rng(seed)
    size = windows.size
    if kernels is None:
        kernels = rng.integers(-127, 128, (outs, size, size, channels), dtype=np.int8)
    spread = 60.0 * 75.0 * np.sqrt(size * size * channels)
    positive = (rng.uniform(0.5, 2.0, outs) * 100.0 / spread * 2.0**36).astype("<i4")
    return IntegerConvolution(
        given,
        windows,
        outs,
        kernels.tobytes(),
        rng.integers(-9000, 9000, outs).astype("<i4").tobytes(),
        positive.tobytes(),
        (positive // 10).astype("<i4").tobytes(),
        np.full(outs, 36, np.int8).tobytes(),
        int(rng.integers(-128, 128)),
    )


def network(*steps: Step, width: int = 8, height: int = 8) -> IntegerNetwork:
    """Of these steps; the description has one head, ``head``."""
    return IntegerNetwork(described(width, height).encode(), "a test", list(steps))


def write_network(path: Path, made: IntegerNetwork) -> Path:
    """The file."""
    path.write_bytes(encode_network(made))
    return path


def write_quantized(folder: Path, name: str) -> Path:
    """A published architecture at a quarter of its width with random weights, quantised."""
    made = quantize(write_float(folder / f"{name}.onnx", name), list(pictures(4)))
    return write_network(folder / f"{name}.integer", made)
