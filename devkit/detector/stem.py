"""The first layers of a network, cut off its graph.

Layers of few channels are what cuDNN is slow at: the first two or three of the shipped networks
took 5 of 11 ms per batch of 32 through all four, on an H200. They are simple, so
:mod:`devkit.detector.thin` computes them (in 1 ms), and ONNX Runtime what comes after.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

IN_MAX, OUT_MAX = 8, 16
"""Channels into a layer and out of it up to which it is cut off."""


@dataclass(frozen=True, slots=True, eq=False)
class StemLayer:
    """A convolution of 3x3 with a border of one zero, and what follows it."""

    kernels: np.ndarray
    """float32 [out, in, 3, 3]."""
    biases: np.ndarray
    """float32 [out]: a bias per channel."""
    stride: int
    """Stride over rows and columns, 1 or 2."""
    slope: float
    """What negative values are multiplied with, 0 to 1; 1: no activation."""
    pool: bool
    """Whether the largest of every 2x2 is taken."""

    def out_shape(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        """Shape of the output for an array of ``shape``, [N, channels, rows, columns]."""
        batch, _, *lines = shape
        size = [(line + self.stride - 1) // self.stride for line in lines]
        return (batch, len(self.biases), *(line // 2 if self.pool else line for line in size))


def cut(model: Any, input_name: str) -> tuple[list[StemLayer], Any, str]:
    """Cut the first layers off.

    Args:
        model: ``onnx.ModelProto``; it stays as it is.
        input_name: of its only input.

    Returns:
        The layers, none if the network does not begin with such; the rest as a model of its own;
        the name of its input.
    """
    import onnx

    if any(_holds_graphs(node) for node in model.graph.node):
        return [], model, input_name  # in which anything may be read
    graph = _Graph(model.graph)
    layers: list[StemLayer] = []
    gone: set[str] = set()
    name = input_name
    while (step := graph.layer(name)) is not None:
        layer, names = step
        layers.append(layer)
        gone.update(names)
        name = names[-1]
    if not layers:
        return [], model, input_name
    rest = onnx.ModelProto()
    rest.CopyFrom(model)
    nodes = [node for node in rest.graph.node if node.output[0] not in gone]
    (batch,) = (
        value.type.tensor_type.shape.dim[0]
        for value in rest.graph.input
        if value.name == input_name
    )
    shape = [batch.dim_value or "batch", len(layers[-1].biases), None, None]
    entry = onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, shape)
    # In old files constants are listed among the inputs, too.
    constants = [value for value in rest.graph.input if value.name != input_name]
    del rest.graph.node[:], rest.graph.input[:], rest.graph.value_info[:]
    rest.graph.node.extend(nodes)
    rest.graph.input.extend([entry, *constants])
    return layers, rest, name


class _Graph:
    """A network's nodes by the tensors that they read and make."""

    def __init__(self, graph: Any) -> None:
        self._constants = {tensor.name: tensor for tensor in graph.initializer}
        self._makers = {node.output[0]: node for node in graph.node if node.output}
        self._results = {value.name for value in graph.output}
        self._readers: dict[str, list[Any]] = {}
        for node in graph.node:
            for name in node.input:
                self._readers.setdefault(name, []).append(node)

    def layer(self, name: str) -> tuple[StemLayer, list[str]] | None:
        """The layer that alone reads ``name``, and the names of what its nodes make; None: it is of
        another kind."""
        convolution = self._reader(name, "Conv")
        if convolution is None or len(convolution.input) < 3:
            return None
        kernels, biases = (self._constant(tensor) for tensor in convolution.input[1:3])
        how = _attributes(convolution)
        stride = how.get("strides", [1, 1])
        if (
            kernels is None
            or biases is None
            or kernels.shape[2:] != (3, 3)
            or kernels.shape[1] > IN_MAX
            or len(kernels) > OUT_MAX
            or biases.shape != kernels.shape[:1]
            or _pads_itself(how)
            or how.get("pads") != [1, 1, 1, 1]
            or stride not in ([1, 1], [2, 2])
            or how.get("group", 1) != 1
            or how.get("dilations", [1, 1]) != [1, 1]
        ):
            return None
        made = [convolution.output[0]]
        slope = 1.0
        activation = self._reader(made[-1], "LeakyRelu")
        if activation is not None:
            slope = _attributes(activation).get("alpha", 0.01)
            made.append(activation.output[0])
        if not 0.0 <= slope <= 1.0:
            return None
        pooling = self._reader(made[-1], "MaxPool")
        pool = pooling is not None and _halves(pooling)
        if pool:
            made.append(pooling.output[0])
        return StemLayer(kernels, biases, stride[0], slope, pool), made

    def _reader(self, name: str, kind: str) -> Any:
        """The node that alone reads ``name``, if it is of this kind."""
        readers = self._readers.get(name, [])
        if name in self._results or len(readers) != 1 or readers[0].op_type != kind:
            return None
        return readers[0]

    def _constant(self, name: str) -> np.ndarray | None:
        """A tensor of the file as float32, also one that is kept in half precision."""
        from onnx import numpy_helper

        maker = self._makers.get(name)
        if maker is not None and maker.op_type == "Cast" and _attributes(maker).get("to") == 1:
            name = maker.input[0]
        tensor = self._constants.get(name)
        return None if tensor is None else numpy_helper.to_array(tensor).astype(np.float32)


def _halves(pooling: Any) -> bool:
    """Whether a node takes the largest of every 2x2."""
    how = _attributes(pooling)
    return (
        how.get("kernel_shape") == [2, 2]
        and how.get("strides") == [2, 2]
        and how.get("pads", [0, 0, 0, 0]) == [0, 0, 0, 0]
        and how.get("dilations", [1, 1]) == [1, 1]
        and not how.get("ceil_mode", 0)
        and not _pads_itself(how)
        and len(pooling.output) == 1
    )


def _pads_itself(how: dict[str, Any]) -> bool:
    return how.get("auto_pad", b"NOTSET") != b"NOTSET"


def _holds_graphs(node: Any) -> bool:
    """Whether a node is a branch or a loop."""
    import onnx

    kinds = (onnx.AttributeProto.GRAPH, onnx.AttributeProto.GRAPHS)
    return any(attribute.type in kinds for attribute in node.attribute)


def _attributes(node: Any) -> dict[str, Any]:
    import onnx

    return {
        attribute.name: onnx.helper.get_attribute_value(attribute) for attribute in node.attribute
    }
