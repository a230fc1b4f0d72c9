"""A Darknet network as a torch module, layer by layer what the ONNX writer writes.

Layers are those of :class:`devkit.darknet.network.DarknetNetwork`, so everything a cfg can say is
trained as it is exported. What differs from the exported file is batch normalisation: here it is a
step of its own, in the exported file it is folded into the kernels.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from devkit.darknet.network import (
    IMAGE,
    Convolutional,
    DarknetNetwork,
    Head,
    MaxPool,
    Reorg,
    Route,
    Shortcut,
    Upsample,
)
from devkit.darknet.onnx_writer import EPSILON
from devkit.darknet.weights import Convolution, Weights

NORMALISATION_MOMENTUM = 0.03
"""Share of the current batch in the running mean and variance [-]."""

PRIOR = {"logistic": 0.01, "softmax": 0.1}
"""Objectness of an untrained network [-]: nearly all boxes are background. YOLOv2's squared error
needs more, because its gradient vanishes near 0."""

VERSION = (0, 2, 5)
"""Version of Darknet's weights, as its last releases write it."""


class TorchNetwork(nn.Module):
    """[N, 3, height, width], 0 to 1 -> the raw input of every head, [N, A (5 + C), rows, columns].

    One module per layer, under the layer's index; layers without weights are functions.
    """

    def __init__(self, network: DarknetNetwork, seed: int) -> None:
        """Kernels are drawn by He et al. (2015) for a leaky slope of 0.1, from ``seed``."""
        super().__init__()
        self.network = network
        self.blocks = nn.ModuleDict(
            {str(layer.index): ConvolutionBlock(layer) for layer in network.convolutions()}
        )
        generator = torch.Generator().manual_seed(seed)
        with torch.no_grad():
            for layer in network.convolutions():
                self.block(layer.index).draw(generator)
            for head in network.heads():
                self._expect_background(head)

    def block(self, index: int) -> ConvolutionBlock:
        """The convolution of layer ``index``."""
        block = self.blocks[str(index)]
        assert isinstance(block, ConvolutionBlock)
        return block

    def forward(self, images: Tensor) -> list[Tensor]:
        """See the class."""
        outputs = self.layers(images)
        return [outputs[head.inputs[0]] for head in self.network.heads()]

    def layers(self, images: Tensor) -> dict[int, Tensor]:
        """Output of every layer but the heads, by index; the images are :data:`IMAGE`."""
        outputs = {IMAGE: images}
        for layer in self.network.layers:
            if isinstance(layer, Head):
                continue
            inputs = [outputs[index] for index in layer.inputs]
            if isinstance(layer, Convolutional):
                outputs[layer.index] = self.block(layer.index)(inputs[0])
            else:
                outputs[layer.index] = _STEPS[type(layer)](layer, inputs)
        return outputs

    def _expect_background(self, head: Head) -> None:
        before = self.network.layers[head.inputs[0]]
        if not isinstance(before, Convolutional):
            return
        bias = self.block(before.index).convolution.bias
        if bias is not None:
            prior = PRIOR[head.scores]
            logits = bias.view(len(head.anchors_px), -1)
            logits[:, 4] = math.log(prior / (1.0 - prior))

    def weights(self, seen: int) -> Weights:
        """The numbers as Darknet has them; ``seen`` images were trained on."""
        convolutions = {
            layer.index: self.block(layer.index).numbers() for layer in self.network.convolutions()
        }
        return Weights(VERSION, seen, convolutions)

    def load_weights(self, weights: Weights) -> None:
        """Take the numbers of a weights file."""
        with torch.no_grad():
            for index, numbers in weights.convolutions.items():
                self.block(index).take(numbers)


class ConvolutionBlock(nn.Module):
    """Convolution, batch normalisation or bias, activation."""

    def __init__(self, layer: Convolutional) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(
            layer.channels,
            layer.shape.channels,
            layer.size,
            layer.stride,
            layer.padding,
            groups=layer.groups,
            bias=not layer.batch_normalize,
        )
        self.normalisation = (
            nn.BatchNorm2d(layer.shape.channels, EPSILON, NORMALISATION_MOMENTUM)
            if layer.batch_normalize
            else None
        )
        if self.normalisation is not None:
            # A count that nobody reads; on a GPU it would be a launch per layer.
            self.normalisation.num_batches_tracked = None
        self._activation = layer.activation

    def forward(self, values: Tensor) -> Tensor:
        """[N, C, H, W] -> [N, F, H', W']."""
        values = self.convolution(values)
        if self.normalisation is not None:
            values = self.normalisation(values)
        return activate(values, self._activation)

    def draw(self, generator: torch.Generator) -> None:
        """Draw the kernels anew; biases become 0."""
        kernels = self.convolution.weight
        if self.normalisation is None:
            nn.init.normal_(kernels, std=0.01, generator=generator)
            assert self.convolution.bias is not None
            nn.init.zeros_(self.convolution.bias)
        else:
            nn.init.kaiming_normal_(kernels, a=0.1, generator=generator)

    def numbers(self) -> Convolution:
        """Numbers of the weights as Darknet has them."""
        kernels = _array(self.convolution.weight)
        norm = self.normalisation
        if norm is None:
            return Convolution(kernels, _array(self.convolution.bias))
        return Convolution(
            kernels,
            biases=_array(norm.bias),
            scales=_array(norm.weight),
            means=_array(norm.running_mean),
            variances=_array(norm.running_var),
        )

    def take(self, numbers: Convolution) -> None:
        """The inverse of :meth:`numbers`."""
        norm = self.normalisation
        pairs: list[tuple[Any, Any]] = [(self.convolution.weight, numbers.kernels)]
        if norm is None:
            pairs.append((self.convolution.bias, numbers.biases))
        else:
            pairs += [
                (norm.bias, numbers.biases),
                (norm.weight, numbers.scales),
                (norm.running_mean, numbers.means),
                (norm.running_var, numbers.variances),
            ]
        for tensor, array in pairs:
            tensor.copy_(torch.from_numpy(np.ascontiguousarray(array)))


def activate(values: Tensor, activation: str) -> Tensor:
    """One of :data:`devkit.darknet.network.Activation`."""
    if activation == "linear":
        return values
    if activation == "leaky":
        return functional.leaky_relu(values, 0.1, inplace=True)
    if activation == "logistic":
        return torch.sigmoid(values)
    if activation == "relu":
        return torch.relu(values)
    if activation == "swish":
        return functional.silu(values)
    return functional.mish(values)


def _maxpool(layer: MaxPool, inputs: list[Tensor]) -> Tensor:
    values = inputs[0]
    before = layer.padding // 2
    rows, columns = values.shape[2:]
    # As many pixels behind the last one as the windows reach, or as are left over.
    after = [
        (out - 1) * layer.stride + layer.size - extent - before
        for out, extent in zip(layer.shape[1:], (rows, columns), strict=True)
    ]
    if before or any(after):
        edges = (before, after[1], before, after[0])
        values = functional.pad(values, edges, value=-math.inf)
    if layer.stride >= layer.size:
        return functional.max_pool2d(values, layer.size, layer.stride)
    # Windows that overlap: CUDA adds their gradients up in any order, autograd in a fixed one.
    height, width = ((out - 1) * layer.stride + 1 for out in layer.shape[1:])
    shifted = [
        values[:, :, y : y + height : layer.stride, x : x + width : layer.stride]
        for y in range(layer.size)
        for x in range(layer.size)
    ]
    return functools.reduce(torch.maximum, shifted)


def _route(layer: Route, inputs: list[Tensor]) -> Tensor:
    parts = [torch.chunk(values, layer.groups, dim=1)[layer.group_id] for values in inputs]
    return parts[0] if len(parts) == 1 else torch.cat(parts, dim=1)


def _shortcut(layer: Shortcut, inputs: list[Tensor]) -> Tensor:
    return activate(inputs[0] + inputs[1], layer.activation)


def _upsample(layer: Upsample, inputs: list[Tensor]) -> Tensor:
    values, stride = inputs[0], layer.stride
    images, channels, rows, columns = values.shape
    # Its gradient is a plain sum, in a fixed order on every device.
    wide = values[:, :, :, None, :, None].expand(-1, -1, -1, stride, -1, stride)
    wide = wide.reshape(images, channels, rows * stride, columns * stride)
    return wide if layer.scale == 1.0 else wide * layer.scale


def _reorg(layer: Reorg, inputs: list[Tensor]) -> Tensor:
    values, s = inputs[0], layer.stride
    images, c, h, w = values.shape
    split = values.reshape(images, c // s**2, h, s, w, s).permute(0, 3, 5, 1, 2, 4)
    return split.reshape(images, c * s**2, h // s, w // s)


def _array(tensor: Tensor | None) -> np.ndarray:
    assert tensor is not None
    return tensor.detach().float().cpu().contiguous().numpy().copy()


_STEPS: dict[type, Any] = {
    MaxPool: _maxpool,
    Route: _route,
    Shortcut: _shortcut,
    Upsample: _upsample,
    Reorg: _reorg,
}
