"""Networks for tests: small enough for milliseconds, real enough to fire."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from devkit.detector.description import METADATA_KEY, DetectorDescription, GridHead

WIDTH, HEIGHT = 32, 32
CELLS = 4


def write_dark_spot_detector(path: Path, *, label: str = "car", names: int = 1) -> Path:
    """A network that calls every dark spot a ``label`` of 12x12 px.

    One convolution: the mean darkness of an 8x8 cell is the objectness.
    """
    size = WIDTH // CELLS
    kernels = np.zeros((5 + names, 3, size, size), np.float32)
    kernels[4] = -60.0 / (3 * size * size)
    biases = np.zeros(5 + names, np.float32)
    biases[4] = 12.0
    biases[5] = 8.0
    nodes = [
        helper.make_node(
            "Conv",
            ["images", "kernels", "biases"],
            ["head"],
            kernel_shape=[size, size],
            strides=[size, size],
        )
    ]
    graph = helper.make_graph(
        nodes,
        "dark_spots",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, ["n", 3, HEIGHT, WIDTH])],
        [helper.make_tensor_value_info("head", TensorProto.FLOAT, ["n", 5 + names, CELLS, CELLS])],
        [
            numpy_helper.from_array(kernels, "kernels"),
            numpy_helper.from_array(biases, "biases"),
        ],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    labels = [label, *(f"other_{n}" for n in range(1, names))]
    description = DetectorDescription(WIDTH, HEIGHT, labels, [GridHead("head", [(12.0, 12.0)])])
    helper.set_model_props(model, {METADATA_KEY: description.encode()})
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, path)
    return path
