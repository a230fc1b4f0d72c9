"""The step from camera pictures to a network's input as an ONNX graph, before the network's own.

So it runs wherever the network runs, on a GPU too, from pictures that lie there. The resize is that
of OpenCV's ``INTER_LINEAR_EXACT``, to the last bit: with weights in 1/256, all sums are whole
numbers below 2^24, which float32 holds exactly, whatever the order or the device
(``tests/unit/devkit/test_detector_frames.py`` compares the two).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from devkit.detector_description import DetectorDescription

FRAMES, ROWS = "drivetwin_frames", "drivetwin_rows"
"""Inputs: uint8 [S, H, W, 3], RGB; int64 [batch], which of them."""

ONE = 256
"""Weight of a whole pixel."""

IR_VERSION_MIN = 4
"""From here on constants need not be inputs as well."""


def taps(given: int, wanted: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the pixels of a line come from.

    Args:
        given: pixels of the line.
        wanted: pixels of the resized line.

    Returns:
        Per resized pixel two indices, int64 [wanted], and the weight of the second, int64 [wanted],
        0 to :data:`ONE`; the first has the rest.
    """
    centre = (np.arange(wanted) + 0.5) * (given / wanted) - 0.5
    first = np.floor(centre).astype(np.int64)
    weight = np.rint((centre - first) * ONE).astype(np.int64)
    outside = (first < 0) | (first >= given - 1)
    first = np.clip(first, 0, given - 1)
    weight[outside] = 0
    return first, np.minimum(first + 1, given - 1), weight


def with_frames(
    model: onnx.ModelProto,
    input_name: str,
    description: DetectorDescription,
    size_px: tuple[int, int],
) -> onnx.ModelProto:
    """A model that takes pictures of ``size_px`` (width, height) instead of ``input_name``."""
    changed = onnx.ModelProto()
    changed.CopyFrom(model)
    changed.ir_version = max(changed.ir_version, IR_VERSION_MIN)
    graph = changed.graph
    width, height = size_px
    steps = _Steps()
    x = steps.add("Gather", [FRAMES, ROWS], axis=0)
    if description.channel_order == "bgr":
        x = steps.add("Gather", [x, steps.constant(np.array([2, 1, 0]))], axis=3)
    if (width, height) == (description.width, description.height):
        x = steps.add("Cast", [x], to=TensorProto.FLOAT)
    else:
        x = _mixed(steps, x, 2, width, description.width, cast=True)
        x = _mixed(steps, x, 1, height, description.height, cast=False)
        half, all_ = np.float32(ONE * ONE / 2), np.float32(1 / (ONE * ONE))
        x = steps.add("Add", [x, steps.constant(half)])
        x = steps.add("Floor", [steps.add("Mul", [x, steps.constant(all_)])])
    x = steps.add("Mul", [x, steps.constant(np.float32(description.scale))])
    steps.add("Transpose", [x], output=input_name, perm=[0, 3, 1, 2])

    nodes = [*steps.nodes, *graph.node]
    inputs = [value for value in graph.input if value.name != input_name]
    inputs += [
        helper.make_tensor_value_info(
            FRAMES, TensorProto.UINT8, ["drivetwin_frames", height, width, 3]
        ),
        helper.make_tensor_value_info(ROWS, TensorProto.INT64, ["drivetwin_rows"]),
    ]
    del graph.node[:], graph.input[:]
    graph.node.extend(nodes)
    graph.input.extend(inputs)
    graph.initializer.extend(steps.constants)
    return changed


def _mixed(steps: _Steps, x: str, axis: int, given: int, wanted: int, *, cast: bool) -> str:
    """Both neighbours along ``axis`` with their weights; whole numbers."""
    first, second, weight = taps(given, wanted)
    shape = [1] * 4
    shape[axis] = wanted
    parts = []
    for index, share in ((first, ONE - weight), (second, weight)):
        part = steps.add("Gather", [x, steps.constant(index)], axis=axis)
        if cast:
            part = steps.add("Cast", [part], to=TensorProto.FLOAT)
        share = share.astype(np.float32).reshape(shape)
        parts.append(steps.add("Mul", [part, steps.constant(share)]))
    return steps.add("Add", parts)


class _Steps:
    """Nodes and constants with names that no model has."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def add(self, kind: str, inputs: list[str], output: str = "", **attributes: Any) -> str:
        """A node; returns the name of its output."""
        name = f"drivetwin_step_{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, inputs, [output or name], name=name, **attributes))
        return output or name

    def constant(self, value: Any) -> str:
        """A constant; returns its name."""
        name = f"drivetwin_constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(value), name))
        return name
