"""A Darknet network as frozen types: every layer with its inputs and its output shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

Activation = Literal["linear", "leaky", "logistic", "relu", "mish", "swish"]
"""leaky: slope 0.1 below zero; mish: x tanh(ln(1 + e^x)); swish: x logistic(x)."""

IMAGE = -1
"""Index of the network's input where layers name theirs."""


class MapShape(NamedTuple):
    """Shape of one image's feature map."""

    channels: int
    height: int
    width: int

    def __str__(self) -> str:
        """``13x13x512``: width, height, channels, as Darknet prints it."""
        return f"{self.width}x{self.height}x{self.channels}"


@dataclass(frozen=True, slots=True, kw_only=True)
class DarknetLayer:
    """Fields that all layers have."""

    index: int
    """Index as Darknet counts: 0 is the first section behind ``[net]``."""
    kind: str
    """Name of the section."""
    line: int
    """Line of the cfg at which the section begins."""
    inputs: tuple[int, ...]
    """Indices of the layers it reads, :data:`IMAGE` for the network's input."""
    shape: MapShape
    """Shape of the layer's output."""

    @property
    def label(self) -> str:
        """Name of the layer in messages."""
        return f"layer {self.index} [{self.kind}]"


@dataclass(frozen=True, slots=True, kw_only=True)
class Convolutional(DarknetLayer):
    """Cross-correlation, then batch normalisation or a bias, then the activation."""

    size: int
    stride: int
    padding: int
    """Zeros on each side."""
    groups: int
    channels: int
    """Channels of the input."""
    batch_normalize: bool
    activation: Activation


@dataclass(frozen=True, slots=True, kw_only=True)
class MaxPool(DarknetLayer):
    """Maximum over a window; pixels outside the image never win.

    Darknet's ``padding`` counts both sides together: ``padding // 2`` of it lies left and above,
    and the output has ``(in + padding - size) // stride + 1`` columns.
    """

    size: int
    stride: int
    padding: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Route(DarknetLayer):
    """Inputs one behind the other; of each only part ``group_id`` of ``groups``."""

    groups: int
    group_id: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Shortcut(DarknetLayer):
    """Sum of its two inputs, then the activation."""

    activation: Activation


@dataclass(frozen=True, slots=True, kw_only=True)
class Upsample(DarknetLayer):
    """Every pixel repeated ``stride`` x ``stride`` times, times ``scale``."""

    stride: int
    scale: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Reorg(DarknetLayer):
    """Space to depth in Darknet's own order.

    Darknet walks the input [c, h, w] as if its memory held [c/s^2, h s, w s]; so the output is not
    the plain space-to-depth of the input. In NumPy, with stride s::

        x.reshape(c // s**2, h, s, w, s).transpose(2, 4, 0, 1, 3).reshape(c * s**2, h // s, w // s)
    """

    stride: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Head(DarknetLayer):
    """``region`` (YOLOv2) or ``yolo`` (YOLOv3): turns its input into boxes.

    Channels of the input, per anchor: x, y, width, height, objectness, one per class.
    """

    anchors_px: tuple[tuple[float, float], ...]
    """(width, height) of those that this head uses, at the network's input size."""
    classes: int
    scores: Literal["softmax", "logistic"]
    scale_xy: float
    """Stretches the box centre's range beyond its cell; 1 is off."""


@dataclass(frozen=True, slots=True)
class DarknetNetwork:
    """All layers in order; ``name`` is the cfg file."""

    name: str
    input: MapShape
    layers: tuple[DarknetLayer, ...]

    def heads(self) -> list[Head]:
        """Heads in the order of the file."""
        return [layer for layer in self.layers if isinstance(layer, Head)]

    def convolutions(self) -> list[Convolutional]:
        """Convolutions in the order of the file, which is that of the weights."""
        return [layer for layer in self.layers if isinstance(layer, Convolutional)]

    def shape_of(self, index: int) -> MapShape:
        """Output shape of a layer, or the input's for :data:`IMAGE`."""
        return self.input if index == IMAGE else self.layers[index].shape
