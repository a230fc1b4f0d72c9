"""Darknet's layers in plain NumPy, one by one, as an oracle for the imported networks.

Written from what Darknet's loops do, not from the importer: kernels are shifted and added,
batch normalisation stays a step of its own, pooling and reorg walk over Darknet's indices.
"""

from __future__ import annotations

import numpy as np

from devkit.darknet.build import build_network
from devkit.darknet.network import (
    Convolutional,
    DarknetNetwork,
    Head,
    MaxPool,
    Reorg,
    Route,
    Shortcut,
    Upsample,
)
from devkit.darknet.sections import parse_sections
from devkit.darknet.weights import Convolution, Weights


def small_network(layers: str, *, width: int, height: int) -> DarknetNetwork:
    """These layers between a convolution and a head of two classes."""
    head = "[convolutional]\nfilters=7\nactivation=linear\n[yolo]\nanchors=8,8\nclasses=2\nnum=1\n"
    text = f"[net]\nwidth={width}\nheight={height}\n[convolutional]\nfilters=8\nactivation=linear\n"
    return build_network(parse_sections(text + layers + head, "a.cfg"), "a.cfg")


def random_weights(network: DarknetNetwork, seed: int, version=(0, 2, 5)) -> Weights:
    """Weights that keep every layer's values near 1, whatever the depth."""
    rng = np.random.default_rng(seed)

    def normal(*shape, scale=1.0, mean=0.0):
        return (mean + scale * rng.standard_normal(shape)).astype(np.float32)

    convolutions = {}
    for layer in network.convolutions():
        filters, inputs = layer.shape.channels, layer.channels // layer.groups
        fan = inputs * layer.size**2
        kernels = normal(filters, inputs, layer.size, layer.size, scale=fan**-0.5)
        biases = normal(filters, scale=0.3)
        if layer.batch_normalize:
            variances = rng.uniform(0.5, 1.5, filters).astype(np.float32)
            more = (normal(filters, scale=0.2, mean=1.1), normal(filters, scale=0.3), variances)
        else:
            more = (None, None, None)
        convolutions[layer.index] = Convolution(kernels, biases, *more)
    return Weights(version, 12345, convolutions)


def forward(network: DarknetNetwork, weights: Weights, images: np.ndarray) -> list[np.ndarray]:
    """Outputs of all layers, float32 [N, C, H, W]; a head's output is its input."""
    outputs: list[np.ndarray] = []
    for layer in network.layers:
        inputs = [images if index < 0 else outputs[index] for index in layer.inputs]
        outputs.append(_layer(layer, inputs, weights))
        assert outputs[-1].shape[1:] == tuple(layer.shape), layer.label
    return outputs


def _layer(layer, inputs, weights):
    match layer:
        case Convolutional():
            return activate(layer.activation, convolve(layer, inputs[0], weights))
        case MaxPool():
            return pool(inputs[0], layer.size, layer.stride, layer.padding)
        case Route():
            size = [x.shape[1] // layer.groups for x in inputs]
            first = [layer.group_id * n for n in size]
            parts = zip(inputs, first, size, strict=True)
            return np.concatenate([x[:, a : a + n] for x, a, n in parts], axis=1)
        case Shortcut():
            return activate(layer.activation, inputs[0] + inputs[1])
        case Upsample():
            repeated = inputs[0].repeat(layer.stride, axis=2).repeat(layer.stride, axis=3)
            return repeated * np.float32(layer.scale)
        case Reorg():
            return np.stack([reorg(x, layer.stride) for x in inputs[0]])
        case Head():
            return inputs[0]
    raise AssertionError(layer)


def convolve(layer: Convolutional, x: np.ndarray, weights: Weights) -> np.ndarray:
    """Without the activation."""
    numbers, p, s = weights.convolutions[layer.index], layer.padding, layer.stride
    padded = np.pad(x, ((0, 0), (0, 0), (p, p), (p, p)))
    _, height, width = layer.shape
    groups = []
    for part, kernels in zip(
        np.split(padded, layer.groups, axis=1),
        np.split(numbers.kernels, layer.groups, axis=0),
        strict=True,
    ):
        total = np.zeros((len(kernels), len(x), height, width), np.float32)
        for dy in range(layer.size):
            for dx in range(layer.size):
                window = part[:, :, dy : dy + s * height : s, dx : dx + s * width : s]
                window = window[:, :, :height, :width]
                total += np.tensordot(kernels[:, :, dy, dx], window, axes=(1, 1))
        groups.append(total.transpose(1, 0, 2, 3))
    out = np.concatenate(groups, axis=1)
    if layer.batch_normalize:
        out = (out - column(numbers.means)) / np.sqrt(column(numbers.variances) + 1e-5)
        out = out * column(numbers.scales)
    return (out + column(numbers.biases)).astype(np.float32)


def column(values: np.ndarray) -> np.ndarray:
    """[F] -> [F, 1, 1]."""
    return values[:, None, None]


def activate(name: str, x: np.ndarray) -> np.ndarray:
    """Darknet's activation functions."""
    if name == "leaky":
        return np.where(x > 0, x, np.float32(0.1) * x)
    if name == "logistic":
        return 1 / (1 + np.exp(-x))
    if name == "relu":
        return np.maximum(x, 0)
    if name == "mish":
        return x * np.tanh(np.log1p(np.exp(x)))
    if name == "swish":
        return x / (1 + np.exp(-x))
    assert name == "linear"
    return x


def pool(x: np.ndarray, size: int, stride: int, padding: int) -> np.ndarray:
    """Darknet's max pooling: window (i, j) begins at (i stride - padding // 2, ...)."""
    height, width = ((n + padding - size) // stride + 1 for n in x.shape[2:])
    out = np.full((*x.shape[:2], height, width), -np.inf, np.float32)
    for i in range(height):
        for j in range(width):
            top, left = i * stride - padding // 2, j * stride - padding // 2
            window = x[:, :, max(top, 0) : top + size, max(left, 0) : left + size]
            out[:, :, i, j] = window.max(axis=(2, 3))
    return out


def reorg(x: np.ndarray, stride: int) -> np.ndarray:
    """Darknet's reorg of one image [c, h, w], index by index as in its C loop."""
    channels, height, width = x.shape
    flat = x.ravel()
    out = np.empty_like(flat)
    out_channels = channels // stride**2
    for k in range(channels):
        offset, c2 = divmod(k, out_channels)
        for j in range(height):
            for i in range(width):
                h2, w2 = j * stride + offset // stride, i * stride + offset % stride
                out[i + width * (j + height * k)] = flat[
                    w2 + width * stride * (h2 + height * stride * c2)
                ]
    return out.reshape(channels * stride**2, height // stride, width // stride)
