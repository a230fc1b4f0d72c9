"""A Darknet network and its weights as an ONNX model.

The network's outputs are the raw inputs of its heads, [N, anchors (5 + classes), rows, columns];
what turns them into boxes stands in the model's metadata
(:class:`devkit.detector.description.DetectorDescription`). Batch size is left open.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from devkit.darknet.network import (
    IMAGE,
    Convolutional,
    DarknetLayer,
    DarknetNetwork,
    Head,
    MapShape,
    MaxPool,
    Reorg,
    Route,
    Shortcut,
    Upsample,
)
from devkit.darknet.sections import DarknetError
from devkit.darknet.weights import Convolution, Weights
from devkit.detector.description import METADATA_KEY, DetectorDescription, GridHead

OPSET = 13
IR_VERSION = 8
"""Old enough for the ONNX Runtime of 2022 and newer, and for OpenCV 5."""

INPUT = "images"
"""Name of the model's input."""

EPSILON = 1e-5
"""Added to the variance in batch normalisation. Darknet's GPU kernels, which trained the published
weights, have this; its CPU code adds 1e-6 to the deviation instead."""


@dataclass(slots=True)
class _Graph:
    network: DarknetNetwork
    weights: Weights
    fold: bool
    half: bool
    nodes: list[onnx.NodeProto] = field(default_factory=list)
    constants: list[onnx.TensorProto] = field(default_factory=list)
    names: dict[int, str] = field(default_factory=lambda: {IMAGE: INPUT})
    """Layer index -> name of its output."""

    def node(self, kind: str, inputs: Sequence[str], name: str, **attributes: Any) -> str:
        """Add a node; ``name`` is the node's and its output's."""
        self.nodes.append(helper.make_node(kind, inputs, [name], name=name, **attributes))
        return name

    def constant(self, name: str, array: np.ndarray) -> str:
        """Add an initialiser."""
        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(array), name))
        return name


def write_onnx(
    network: DarknetNetwork,
    weights: Weights,
    names: Sequence[str],
    *,
    fold: bool = True,
    half: bool = False,
    every_layer: bool = False,
) -> onnx.ModelProto:
    """A Darknet network and its weights as an ONNX model.

    Args:
        network: shapes and layers.
        weights: its numbers.
        names: labels of the classes.
        fold: batch normalisation becomes part of the kernels and a bias; otherwise it stays a
            node of its own.
        half: kernels are stored as float16, which halves the file, and become float32 when it is
            loaded; the network computes in float32 either way.
        every_layer: every layer's output is an output of the model, ``layer_0`` and so on, for
            comparisons.
    """
    graph = _Graph(network, weights, fold, half)
    heads: list[tuple[str, Head]] = []
    for layer in network.layers:
        if isinstance(layer, Head):
            # A name that no other node has: the same tensor may be the output of a route, too.
            name = graph.node("Identity", [graph.names[layer.inputs[0]]], f"head_{len(heads)}")
            heads.append((name, layer))
            continue
        graph.names[layer.index] = _WRITERS[type(layer)](graph, layer, f"layer_{layer.index}")
    outputs = [_value(name, head.shape) for name, head in heads]
    if every_layer:
        # A route of one layer is that layer, and has no output of its own.
        outputs += [
            _value(name, network.shape_of(i))
            for i, name in graph.names.items()
            if name == f"layer_{i}"
        ]
    model = helper.make_model(
        helper.make_graph(
            graph.nodes, "darknet", [_value(INPUT, network.input)], outputs, graph.constants
        ),
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="drivetwin",
    )
    description = describe(network, names)
    helper.set_model_props(model, {METADATA_KEY: description.encode()})
    onnx.checker.check_model(model, full_check=True)
    return model


def describe(network: DarknetNetwork, names: Sequence[str]) -> DetectorDescription:
    """What decoding needs to know of ``network``."""
    return DetectorDescription(
        width=network.input.width,
        height=network.input.height,
        names=list(names),
        heads=[
            GridHead(f"head_{i}", list(head.anchors_px), head.scores, head.scale_xy)
            for i, head in enumerate(network.heads())
        ],
    )


def folded(numbers: Convolution) -> tuple[np.ndarray, np.ndarray]:
    """Kernels and biases that do the batch normalisation, too, float32."""
    if numbers.scales is None or numbers.means is None or numbers.variances is None:
        return numbers.kernels, numbers.biases
    factor = numbers.scales.astype(np.float64) / np.sqrt(
        numbers.variances.astype(np.float64) + EPSILON
    )
    kernels = numbers.kernels * factor[:, None, None, None]
    biases = numbers.biases - numbers.means * factor
    return kernels.astype(np.float32), biases.astype(np.float32)


def _convolutional(graph: _Graph, layer: Convolutional, name: str) -> str:
    numbers = graph.weights.convolutions[layer.index]
    normalize = layer.batch_normalize and not graph.fold
    kernels, biases = folded(numbers) if not normalize else (numbers.kernels, None)
    inputs = [graph.names[layer.inputs[0]], _stored(graph, kernels, f"{name}_kernels")]
    if biases is not None:
        inputs.append(graph.constant(f"{name}_biases", biases))
    out = graph.node(
        "Conv",
        inputs,
        f"{name}_convolution" if normalize else _before(layer.activation, name),
        kernel_shape=[layer.size] * 2,
        strides=[layer.stride] * 2,
        pads=[layer.padding] * 4,
        group=layer.groups,
    )
    if normalize:
        constants = [
            graph.constant(f"{name}_{part}", getattr(numbers, part))
            for part in ("scales", "biases", "means", "variances")
        ]
        out = graph.node(
            "BatchNormalization",
            [out, *constants],
            _before(layer.activation, name),
            epsilon=EPSILON,
        )
    return _activate(graph, layer.activation, out, name)


def _stored(graph: _Graph, kernels: np.ndarray, name: str) -> str:
    if not graph.half:
        return graph.constant(name, kernels)
    if np.abs(kernels).max() > np.finfo(np.float16).max:
        raise DarknetError(f"{graph.network.name}: {name} holds numbers too large for float16")
    stored = graph.constant(f"{name}_half", kernels.astype(np.float16))
    return graph.node("Cast", [stored], name, to=TensorProto.FLOAT)


def _before(activation: str, name: str) -> str:
    """Name of what goes into the activation of layer ``name``."""
    return name if activation == "linear" else f"{name}_linear"


def _activate(graph: _Graph, activation: str, value: str, name: str) -> str:
    if activation == "linear":
        return value
    if activation == "leaky":
        return graph.node("LeakyRelu", [value], name, alpha=0.1)
    if activation == "logistic":
        return graph.node("Sigmoid", [value], name)
    if activation == "relu":
        return graph.node("Relu", [value], name)
    if activation == "swish":
        return graph.node("Mul", [value, graph.node("Sigmoid", [value], f"{name}_gate")], name)
    # The operator Mish is of opset 18; these three are of any.
    softplus = graph.node("Softplus", [value], f"{name}_softplus")
    return graph.node("Mul", [value, graph.node("Tanh", [softplus], f"{name}_gate")], name)


def _maxpool(graph: _Graph, layer: MaxPool, name: str) -> str:
    before = layer.padding // 2
    shape = graph.network.shape_of(layer.inputs[0])
    # Behind the last pixel just what the windows reach beyond it.
    after = [
        max((out - 1) * layer.stride + layer.size - extent - before, 0)
        for out, extent in zip(layer.shape[1:], shape[1:], strict=True)
    ]
    return graph.node(
        "MaxPool",
        [graph.names[layer.inputs[0]]],
        name,
        kernel_shape=[layer.size] * 2,
        strides=[layer.stride] * 2,
        pads=[before, before, *after],
    )


def _route(graph: _Graph, layer: Route, name: str) -> str:
    parts = [_part(graph, layer, i, f"{name}_{n}") for n, i in enumerate(layer.inputs)]
    if len(parts) == 1:
        return parts[0]
    return graph.node("Concat", parts, name, axis=1)


def _part(graph: _Graph, layer: Route, index: int, name: str) -> str:
    """The channels of layer ``index`` that ``layer`` takes."""
    if layer.groups == 1:
        return graph.names[index]
    channels = graph.network.shape_of(index).channels // layer.groups
    first = layer.group_id * channels
    ends = [
        graph.constant(f"{name}_{part}", np.array([value], np.int64))
        for part, value in (("start", first), ("end", first + channels), ("axis", 1))
    ]
    return graph.node("Slice", [graph.names[index], *ends], f"{name}_part")


def _shortcut(graph: _Graph, layer: Shortcut, name: str) -> str:
    inputs = [graph.names[index] for index in layer.inputs]
    out = graph.node("Add", inputs, _before(layer.activation, name))
    return _activate(graph, layer.activation, out, name)


def _upsample(graph: _Graph, layer: Upsample, name: str) -> str:
    scales = np.array([1, 1, layer.stride, layer.stride], np.float32)
    out = graph.node(
        "Resize",
        [graph.names[layer.inputs[0]], "", graph.constant(f"{name}_scales", scales)],
        name if layer.scale == 1.0 else f"{name}_larger",
        mode="nearest",
        coordinate_transformation_mode="asymmetric",
        nearest_mode="floor",
    )
    if layer.scale == 1.0:
        return out
    factor = graph.constant(f"{name}_factor", np.array(layer.scale, np.float32))
    return graph.node("Mul", [out, factor], name)


def _reorg(graph: _Graph, layer: Reorg, name: str) -> str:
    s = layer.stride
    channels, height, width = graph.network.shape_of(layer.inputs[0])
    as_if = np.array([-1, channels // s**2, height, s, width, s], np.int64)
    out = graph.node(
        "Reshape",
        [graph.names[layer.inputs[0]], graph.constant(f"{name}_as_if", as_if)],
        f"{name}_split",
    )
    out = graph.node("Transpose", [out], f"{name}_order", perm=[0, 3, 5, 1, 2, 4])
    shape = graph.constant(f"{name}_shape", np.array([-1, *layer.shape], np.int64))
    return graph.node("Reshape", [out, shape], name)


def _value(name: str, shape: MapShape) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", *shape])


_WRITERS: dict[type[DarknetLayer], Callable[[_Graph, Any, str], str]] = {
    Convolutional: _convolutional,
    MaxPool: _maxpool,
    Route: _route,
    Shortcut: _shortcut,
    Upsample: _upsample,
    Reorg: _reorg,
}
