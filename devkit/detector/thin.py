"""Convolutions of few channels as Warp kernels: see :mod:`devkit.detector.stem`.

A thread computes all channels of 2x2 neighbouring pixels, in the same order whatever the batch.
"""

# Annotations are not postponed here: those of the kernels name types that are made in a function.

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import warp as wp

from devkit.detector.stem import StemLayer


@wp.func
def _pixel(values: wp.array4d(dtype=wp.float32), n: int, channel: int, y: int, x: int):
    """0 beyond the border."""
    if y < 0 or x < 0 or y >= values.shape[2] or x >= values.shape[3]:
        return wp.float32(0.0)
    return values[n, channel, y, x]


@cache
def layer_kernel(channels: int) -> wp.Kernel:
    """The kernel for layers with so many channels out."""
    vector = wp.types.vector(length=channels, dtype=wp.float32)

    @wp.func
    def activated(total: vector, bias: vector, slope: wp.float32):
        value = total + bias
        return wp.max(value, value * slope)

    @wp.func
    def write(values: wp.array4d(dtype=wp.float32), n: int, y: int, x: int, value: vector):
        if y < values.shape[2] and x < values.shape[3]:
            for channel in range(wp.static(channels)):
                values[n, channel, y, x] = value[channel]

    @wp.kernel(enable_backward=False, module="unique", module_options={"fuse_fp": False})
    def kernel(
        # model
        weights: wp.array2d(dtype=vector),
        biases: wp.array(dtype=vector),
        stride: wp.int32,
        slope: wp.float32,
        pool: wp.int32,
        # state in
        given: wp.array4d(dtype=wp.float32),
        # out
        made: wp.array4d(dtype=wp.float32),
    ):
        n, row, column = wp.tid()
        y, x = 2 * row * stride - 1, 2 * column * stride - 1
        a, b, c, d = vector(), vector(), vector(), vector()
        for channel in range(weights.shape[0]):
            for tap in range(9):
                v, u = y + tap / 3, x + tap % 3
                weight = weights[channel, tap]
                a += weight * _pixel(given, n, channel, v, u)
                b += weight * _pixel(given, n, channel, v, u + stride)
                c += weight * _pixel(given, n, channel, v + stride, u)
                d += weight * _pixel(given, n, channel, v + stride, u + stride)
        bias = biases[0]
        a, b = activated(a, bias, slope), activated(b, bias, slope)
        c, d = activated(c, bias, slope), activated(d, bias, slope)
        if pool != 0:
            write(made, n, row, column, wp.max(wp.max(a, b), wp.max(c, d)))
        else:
            write(made, n, 2 * row, 2 * column, a)
            write(made, n, 2 * row, 2 * column + 1, b)
            write(made, n, 2 * row + 1, 2 * column, c)
            write(made, n, 2 * row + 1, 2 * column + 1, d)

    return kernel


class ThinLayers:
    """Some layers, one after the other, of a batch that lies in ``given``."""

    def __init__(
        self, layers: Sequence[StemLayer], given: wp.array, stream: "wp.Stream | None"
    ) -> None:
        """Allocate the layers.

        ``given``: [N, channels, rows, columns]; ``stream``: the stream in which work is queued.

        Raises:
            ValueError: a layer reads another number of channels; one line.
        """
        self._stream = stream
        self._launches: list[Any] = []
        self._arrays: list[wp.array] = []
        self.out = given
        """What the last layer makes, of the same kind."""
        for layer in layers:
            self._add(layer)
        wp.synchronize_device(given.device)  # arrays were filled in another stream

    def _add(self, layer: StemLayer) -> None:
        reads, available = layer.kernels.shape[1], self.out.shape[1]
        if reads != available:  # the kernel would read what lies behind the pictures
            raise ValueError(f"a convolution reads {reads} channels, given {available}")
        device, channels = self.out.device, len(layer.biases)
        vector = wp.types.vector(length=channels, dtype=wp.float32)
        # Of each channel in and each tap all channels out, together.
        taps = layer.kernels.transpose(1, 2, 3, 0).reshape(reads, 9, channels)
        weights = wp.array(np.ascontiguousarray(taps), dtype=vector, device=device)
        biases = wp.array(layer.biases[None], dtype=vector, device=device)
        made = wp.zeros(layer.out_shape(self.out.shape), dtype=wp.float32, device=device)
        batch, _, rows, columns = made.shape
        if not layer.pool:
            rows, columns = (rows + 1) // 2, (columns + 1) // 2
        how = [layer.stride, layer.slope, int(layer.pool)]
        launch = wp.launch(
            layer_kernel(channels),
            (batch, rows, columns),
            inputs=[weights, biases, *how, self.out],
            outputs=[made],
            device=device,
            record_cmd=True,
        )
        self._launches.append(launch)
        self._arrays += [weights, biases, made]  # Warp does not say whether a launch keeps them
        self.out = made

    def run(self) -> None:
        """Queue all of them."""
        for launch in self._launches:
            launch.launch(stream=self._stream)
