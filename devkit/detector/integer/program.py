"""An integer network in the memory of one device, ready to run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import warp as wp

from devkit.detector.integer.convolution import (
    convolution_kernel,
    prepared,
    threads_per_image,
)
from devkit.detector.integer.map_kernels import join_kernel, pool_kernel, sum_kernel
from devkit.detector.integer.shapes import LevelShape, room_floats
from devkit.detector.integer.steps import (
    IntegerConvolution,
    IntegerHead,
    IntegerJoin,
    IntegerPool,
    IntegerSum,
    JoinPart,
    Step,
)

CPU_RUN = 1 << 29
"""Levels of a CPU's thread: all that it may have."""

Launch = Callable[[int], None]
"""Queues a step for so many images."""


class IntegerProgram:
    """Maps and launches of a batch of images."""

    def __init__(
        self,
        steps: Sequence[Step],
        shapes: Sequence[LevelShape],
        picture: wp.array,
        stream: wp.Stream | None,
    ) -> None:
        """Allocate everything.

        Args:
            steps: of the network.
            shapes: of :func:`devkit.detector.integer.shapes.map_shapes`.
            picture: where levels of pictures will be, int8 [batch, rows, columns, 4].
            stream: in which work is queued; None: the CPU's.
        """
        device = picture.device
        self._device, self._stream = device, stream
        self._run = CPU_RUN if device.is_cpu else 1
        self._shapes = shapes
        made = [self._map(shape, picture.shape[0]) for shape in shapes[1:]]
        self._maps = [picture, *made]
        self._kept: list[Any] = []
        convolutions = [
            (step, shapes[step.given], shapes[number])
            for number, step in enumerate(steps, 1)
            if isinstance(step, IntegerConvolution | IntegerHead)
        ]
        floats = max((room_floats(*one) for one in convolutions), default=1)
        self._room = wp.zeros(floats if device.is_cpu else 1, dtype=wp.float32, device=device)
        self._launches: list[Launch] = []
        for number, step in enumerate(steps, 1):
            self._add(step, number)
        if device.is_cuda:
            wp.synchronize_device(device)  # arrays were filled in another stream

    def sums(self, number: int) -> wp.array:
        """What step ``number`` - 1, a head, makes: int32 [batch, rows, columns, stored]."""
        return self._maps[number]

    def levels(self, number: int) -> np.ndarray:
        """Map ``number`` of all images, [batch, rows, columns, channels]."""
        array: np.ndarray = self._maps[number].numpy()
        return array[..., : self._shapes[number].channels]

    def run(self, count: int) -> None:
        """Queue all steps for the first ``count`` images."""
        for launch in self._launches:
            launch(count)

    def _map(self, shape: LevelShape, batch: int) -> wp.array:
        dtype = wp.int32 if shape.head else wp.int8
        return wp.zeros((batch, *shape.stored_shape), dtype=dtype, device=self._device)

    def _add(self, step: Step, number: int) -> None:
        if isinstance(step, IntegerConvolution | IntegerHead):
            self._add_convolution(step, number)
        elif isinstance(step, IntegerPool):
            given, made = self._maps[step.given], self._maps[number]
            windows = step.windows
            how = [self._run, windows.size, windows.stride, *windows.pads[:2]]
            parts = self._parts(made.shape[2] * made.shape[3] // 4)
            self._launch(pool_kernel, (made.shape[1], parts), [*how, given], made)
        elif isinstance(step, IntegerSum):
            shapes, maps = self._shapes, self._maps
            zeros = wp.vec2i(shapes[step.first].zero, shapes[step.second].zero)
            how = [self._run, wp.vec2l(*step.factors), zeros, step.shift, step.zero]
            given = [_flat(maps[step.first]), _flat(maps[step.second])]
            made = _flat(maps[number])
            self._launch(sum_kernel, (self._parts(made.shape[1]),), [*how, *given], made)
        else:
            self._add_join(step, number)

    def _add_convolution(self, step: IntegerConvolution | IntegerHead, number: int) -> None:
        given, made = self._shapes[step.given], self._shapes[number]
        model = prepared(step, given, made, self._device)
        target = self._maps[number]
        if made.head:  # the kernel writes levels or sums, and is told which
            length = target.size * 4
            target = wp.array(ptr=target.ptr, shape=length, dtype=wp.int8, device=self._device)
        inputs = [*model, self._maps[step.given].flatten(), self._room]
        threads = threads_per_image(made, self._device)
        self._kept += inputs
        command = wp.launch(
            convolution_kernel,
            threads,
            inputs=inputs,
            outputs=[target.flatten()],
            device=self._device,
            record_cmd=True,
        )
        self._queue(command, lambda count: count * threads)

    def _add_join(self, step: IntegerJoin, number: int) -> None:
        made, first = self._maps[number], 0
        for part in step.parts:
            given = self._shapes[part.given]
            table = _table(part, given.zero, step.zero)
            sources, targets = _places(part, given, self._shapes[number], first)
            first += given.channels * part.fold**2
            model = [
                wp.array(array, dtype=dtype, device=self._device)
                for array, dtype in ((table, wp.int8), (sources, wp.int32), (targets, wp.int32))
            ]
            inputs = [self._run, *model, _flat(self._maps[part.given])]
            self._launch(join_kernel, (self._parts(len(sources)),), inputs, _flat(made))

    def _parts(self, levels: int) -> int:
        return -(-levels // self._run)

    def _launch(
        self, kernel: wp.Kernel, per_image: tuple[int, ...], inputs: list[Any], made: wp.array
    ) -> None:
        self._kept += [*inputs, made]
        command = wp.launch(
            kernel,
            (1, *per_image),
            inputs=inputs,
            outputs=[made],
            device=self._device,
            record_cmd=True,
        )
        self._queue(command, lambda count: (count, *per_image))

    def _queue(self, command: Any, size: Callable[[int], Any]) -> None:
        def launch(count: int) -> None:
            command.set_dim(size(count))
            command.launch(stream=self._stream)

        self._launches.append(launch)


def _flat(array: wp.array) -> wp.array:
    """[N, rows, columns, channels] -> [N, levels]."""
    return array.reshape((array.shape[0], array.size // array.shape[0]))


def _table(part: JoinPart, zero: int, made_zero: int) -> np.ndarray:
    """Level + 128 -> level of the joined map, int8 [256]."""
    values = (np.arange(-128, 128) - zero) * np.int64(part.factor)
    levels = ((values + (1 << (part.shift - 1))) >> part.shift) + made_zero
    return np.clip(levels, -128, 127).astype(np.int8)


def _places(
    part: JoinPart, given: LevelShape, made: LevelShape, first: int
) -> tuple[np.ndarray, np.ndarray]:
    """Where the levels of a part lie in its map and go in the joined one, in the order of the
    latter; ``first``: the part's first channel there."""
    rows, columns, channels, fold = given.rows, given.columns, given.channels, part.fold
    pixels = np.arange(rows * columns).reshape(1, rows, columns) * given.stored
    places = pixels + np.arange(channels).reshape(-1, 1, 1)
    # Darknet folds as if the array had another shape, see devkit.darknet.onnx_writer.
    as_if = places.reshape(channels // fold**2, rows, fold, columns, fold)
    folded = as_if.transpose(2, 4, 0, 1, 3)
    folded = folded.reshape(channels * fold**2, rows // fold, columns // fold)
    placed = folded.repeat(part.repeat, axis=1).repeat(part.repeat, axis=2)
    sources = placed.transpose(1, 2, 0)
    pixels = np.arange(made.rows * made.columns).reshape(made.rows, made.columns, 1)
    targets = pixels * made.stored + first + np.arange(sources.shape[2])
    return sources.reshape(-1), targets.reshape(-1)
