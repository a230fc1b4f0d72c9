"""An ONNX file as the few kinds of steps that integer networks have, still with real numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from devkit.detector.integer.steps import Windows
from devkit.detector.runtime import ModelError

SUPPORTED = "Conv, LeakyRelu, Relu, MaxPool, Add, Concat, Resize (nearest), Identity, Cast, and "
"""Operators that can be made whole numbers; Darknet's reorg is Reshape, Transpose, Reshape."""


@dataclass(frozen=True, slots=True, eq=False)
class FloatConvolution:
    """A convolution with an activation by sign."""

    given: int
    windows: Windows
    kernels: np.ndarray
    """float64 [outs, channels, size, size]."""
    biases: np.ndarray
    """float64 [outs]."""
    slope: float
    """What negative sums are multiplied with, 0 to 1; 1: no activation."""
    tensor: str
    """Name of what it makes in the ONNX file."""
    output: str = ""
    """Name of the output that it is; empty: none."""


@dataclass(frozen=True, slots=True)
class FloatPool:
    """Maxima."""

    given: int
    windows: Windows
    tensor: str


@dataclass(frozen=True, slots=True)
class FloatSum:
    """Two maps added."""

    first: int
    second: int
    tensor: str


@dataclass(frozen=True, slots=True)
class MapView:
    """A map as somebody reads it: repeated or folded, see :class:`steps.JoinPart`."""

    given: int
    repeat: int = 1
    fold: int = 1


@dataclass(frozen=True, slots=True)
class FloatJoin:
    """Maps beside each other."""

    parts: Sequence[MapView]
    tensor: str


FloatStep = FloatConvolution | FloatPool | FloatSum | FloatJoin


@dataclass(slots=True)
class GraphReader:
    """Reads the nodes of a model in their order."""

    path: Path
    model: Any
    """``onnx.ModelProto``."""
    steps: list[FloatStep] = field(default_factory=list)
    _views: dict[str, MapView] = field(default_factory=dict)
    _constants: dict[str, np.ndarray] = field(default_factory=dict)

    def read(self, input_name: str, outputs: Sequence[str]) -> list[FloatStep]:
        """Steps of the network. ``outputs``: names of the heads.

        Raises:
            ModelError: an operator, or a use of one, that has no step; one line that names it.
        """
        from onnx import numpy_helper

        graph = self.model.graph
        self._constants = {t.name: numpy_helper.to_array(t) for t in graph.initializer}
        self._views = {input_name: MapView(0)}
        readers: dict[str, list[Any]] = {}
        for node in graph.node:
            for name in node.input:
                readers.setdefault(name, []).append(node)
        done: set[str] = set()
        names = {output: self._source(output) for output in outputs}
        for node in graph.node:
            if node.output and node.output[0] not in done:
                done.update(self._node(node, readers, set(names.values())))
        heads = {tensor: output for output, tensor in names.items()}
        made = {step.tensor: number for number, step in enumerate(self.steps)}
        for tensor, output in heads.items():
            number = made.get(tensor)
            step = self.steps[number] if number is not None else None
            if not isinstance(step, FloatConvolution) or step.slope != 1.0:
                self._refuse(f"output '{output}' is not what a Conv makes")
            if readers_of(self.steps, number + 1):
                self._refuse(f"output '{output}' is read by other layers, too")
            self.steps[number] = replace(step, output=output)
        return self.steps

    def _source(self, output: str) -> str:
        """The tensor that an output is, past nodes that change nothing."""
        makers = {name: node for node in self.model.graph.node for name in node.output}
        while (node := makers.get(output)) is not None and node.op_type == "Identity":
            output = node.input[0]
        return output

    def _node(self, node: Any, readers: dict[str, list[Any]], heads: set[str]) -> list[str]:
        """Add a node; the tensors that are made now."""
        how, kind, out = attributes(node), node.op_type, node.output[0]
        if kind == "Constant" and "value" in how:
            from onnx import numpy_helper

            self._constants[out] = numpy_helper.to_array(how["value"])
        elif kind == "Cast" and node.input[0] in self._constants:
            self._constants[out] = self._constants[node.input[0]].astype(np.float32)
        elif kind == "Identity" and node.input[0] in self._views:
            self._views[out] = self._views[node.input[0]]
        elif kind == "Conv":
            return self._convolution(node, how, readers, heads)
        elif kind == "MaxPool":
            if len(node.output) > 1 or how.get("ceil_mode", 0):
                self._refuse_node(node, "with indices or ceil_mode")
            step = FloatPool(self._map(node.input[0], node), self._windows(node, how), out)
            self._made(out, step)
        elif kind == "Add":
            self._made(out, FloatSum(*(self._map(name, node) for name in node.input), out))
        elif kind == "Concat" and how.get("axis") == 1:
            self._made(out, FloatJoin([self._view(name, node) for name in node.input], out))
        elif kind == "Resize":
            self._views[out] = MapView(
                self._map(node.input[0], node), repeat=self._repeat(node, how)
            )
        elif kind == "Reshape":
            return self._reorg(node, readers)
        else:
            self._refuse_node(node)
        return [out]

    def _convolution(
        self, node: Any, how: dict[str, Any], readers: dict[str, list[Any]], heads: set[str]
    ) -> list[str]:
        kernels = self._number(node.input[1], node)
        if kernels.ndim != 4 or kernels.shape[2] != kernels.shape[3] or how.get("group", 1) != 1:
            self._refuse_node(node, f"with kernels {list(kernels.shape)} in groups or not square")
        biases = np.zeros(len(kernels))
        if len(node.input) > 2:
            biases = self._number(node.input[2], node)
        out, slope = node.output[0], 1.0
        made = [out]
        followers = readers.get(out, [])
        kind = followers[0].op_type if len(followers) == 1 and out not in heads else ""
        if kind in ("LeakyRelu", "Relu"):
            alpha = attributes(followers[0]).get("alpha", 0.01)
            slope = alpha if kind == "LeakyRelu" else 0.0
            made.append(followers[0].output[0])
        if not 0.0 <= slope <= 1.0:
            self._refuse_node(followers[0], f"with a slope of {slope:g}, allowed: 0 to 1")
        step = FloatConvolution(
            self._map(node.input[0], node),
            self._windows(node, {"kernel_shape": kernels.shape[2:], **how}),
            kernels,
            biases,
            slope,
            made[-1],
        )
        self._made(made[-1], step)
        return made

    def _reorg(self, node: Any, readers: dict[str, list[Any]]) -> list[str]:
        """Darknet's reorg as :mod:`devkit.darknet.onnx_writer` has it: three nodes."""
        shape = self._constants.get(node.input[1], np.zeros(0)).tolist()
        chain = [node]
        for kind in ("Transpose", "Reshape"):
            followers = readers.get(chain[-1].output[0], [])
            if len(followers) != 1 or followers[0].op_type != kind:
                self._refuse_node(node)
            chain.append(followers[0])
        order = attributes(chain[1]).get("perm")
        fold = int(shape[3]) if len(shape) == 6 else 0
        wanted = [-1, shape[1] * fold**4, shape[2] // fold, shape[4] // fold] if fold > 0 else []
        last = self._constants.get(chain[2].input[1], np.zeros(0)).tolist()
        if fold < 1 or shape[5] != fold or order != [0, 3, 5, 1, 2, 4] or last != wanted:
            self._refuse_node(node)
        self._views[chain[2].output[0]] = MapView(self._map(node.input[0], node), fold=fold)
        return [link.output[0] for link in chain]

    def _repeat(self, node: Any, how: dict[str, Any]) -> int:
        """How many rows and columns a Resize makes of one."""
        scales = self._constants.get(node.input[2] if len(node.input) == 3 else "", np.zeros(0))
        nearest = how.get("mode") == b"nearest" and how.get("nearest_mode") == b"floor"
        asymmetric = how.get("coordinate_transformation_mode") == b"asymmetric"
        factors = scales.tolist()
        if (
            not (nearest and asymmetric and len(factors) == 4)
            or factors != [1, 1, factors[2], factors[2]]
            or factors[2] not in range(1, 33)
        ):
            self._refuse_node(node, "that is not nearest, asymmetric and by a whole number")
        return int(factors[2])

    def _windows(self, node: Any, how: dict[str, Any]) -> Windows:
        sizes = list(how.get("kernel_shape", []))
        strides = list(how.get("strides", [1, 1]))
        pads = list(how.get("pads", [0, 0, 0, 0]))
        square = len(sizes) == 2 and len(set(sizes)) == len(set(strides)) == 1
        plain = how.get("auto_pad", b"NOTSET") in (b"NOTSET", b"VALID")
        if not square or not plain or set(how.get("dilations", [1])) != {1} or len(pads) != 4:
            self._refuse_node(node, "that is not square, or is dilated, or pads itself")
        if max(sizes[0], strides[0]) > 32 or not all(0 <= pad < sizes[0] for pad in pads):
            self._refuse_node(node, "with windows above 32, or pads as large as a window")
        return Windows(int(sizes[0]), int(strides[0]), tuple(int(pad) for pad in pads))

    def _number(self, name: str, node: Any) -> np.ndarray:
        """A constant of a node, float64."""
        if name not in self._constants:
            self._refuse_node(node, "with kernels that the network computes")
        values = self._constants[name].astype(np.float64)
        if not np.isfinite(values).all():
            self._refuse(f"'{name}' has numbers that are not finite")
        return values

    def _view(self, name: str, node: Any) -> MapView:
        if name not in self._views:
            self._refuse_node(node, "of a constant")
        return self._views[name]

    def _map(self, name: str, node: Any) -> int:
        """The map that a tensor is, made if it is only a view so far."""
        view = self._view(name, node)
        if (view.repeat, view.fold) != (1, 1):
            self._made(name, FloatJoin([view], name))
        return self._views[name].given

    def _made(self, name: str, step: FloatStep) -> None:
        self.steps.append(step)
        self._views[name] = MapView(len(self.steps))

    def _refuse_node(self, node: Any, what: str = "") -> NoReturn:
        where = f" (makes '{node.output[0]}')"
        kind = f"operator {node.op_type} {what}".rstrip()
        self._refuse(f"{kind}{where} cannot be whole numbers; allowed: {SUPPORTED}Darknet's reorg")

    def _refuse(self, what: str) -> NoReturn:
        raise ModelError(f"{self.path}: {what}")


def readers_of(steps: Sequence[FloatStep], number: int) -> list[int]:
    """Steps that read map ``number``."""
    return [index for index, step in enumerate(steps) if number in given_maps(step)]


def given_maps(step: FloatStep) -> list[int]:
    """Maps that a step reads."""
    if isinstance(step, FloatSum):
        return [step.first, step.second]
    if isinstance(step, FloatJoin):
        return [part.given for part in step.parts]
    return [step.given]


def attributes(node: Any) -> dict[str, Any]:
    """A node's attributes by name."""
    import onnx

    return {a.name: onnx.helper.get_attribute_value(a) for a in node.attribute}
