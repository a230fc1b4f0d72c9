"""Integer networks in plain NumPy, written from the format's description: one loop per idea."""

from __future__ import annotations

import numpy as np

from devkit.detector.integer.steps import (
    IntegerConvolution,
    IntegerHead,
    IntegerJoin,
    IntegerNetwork,
    IntegerPool,
    IntegerSum,
    Windows,
)


def nearest(values: np.ndarray, shift) -> np.ndarray:
    """To the nearest, halves upwards, of Python's own integers: no overflow, no machine word."""
    halves = np.broadcast_to(shift, values.shape)
    flat = [
        (int(v) + 2 ** (int(s) - 1)) // 2 ** int(s)
        for v, s in zip(values.ravel().tolist(), halves.ravel().tolist(), strict=True)
    ]
    return np.array(flat, np.int64).reshape(values.shape)


def windows_of(array: np.ndarray, windows: Windows, border: int) -> np.ndarray:
    """int64 [N, rows, columns, size, size, channels]."""
    top, left, bottom, right = windows.pads
    wide = np.pad(array, ((0, 0), (top, bottom), (left, right), (0, 0)), constant_values=border)
    size, stride = windows.size, windows.stride
    view = np.lib.stride_tricks.sliding_window_view(wide, (size, size), axis=(1, 2))
    return view[:, ::stride, ::stride].transpose(0, 1, 2, 4, 5, 3)


def maps(network: IntegerNetwork, pictures: np.ndarray) -> list[np.ndarray]:
    """All maps, int64 [N, rows, columns, channels]; heads as sums.

    ``pictures``: uint8 [N, rows, columns, 3] of the network's size, in its order of channels.
    """
    made = [pictures.astype(np.int64) - 128]
    zeros = [-128]
    for step in network.steps:
        if isinstance(step, IntegerConvolution | IntegerHead):
            given, zero = made[step.given], zeros[step.given]
            size, channels = step.windows.size, given.shape[3]
            kernels = np.frombuffer(step.kernels, np.int8).astype(np.int64)
            kernels = kernels.reshape(step.outs, size, size, channels)
            found = windows_of(given, step.windows, zero)
            value = np.einsum("nrcyxi,oyxi->nrco", found, kernels)
            value += np.frombuffer(step.biases, "<i4")
            if isinstance(step, IntegerConvolution):
                positive, negative = (
                    np.frombuffer(data, "<i4").astype(np.int64)
                    for data in (step.positive, step.negative)
                )
                factor = np.where(value < 0, negative, positive)
                value = nearest(value * factor, np.frombuffer(step.shifts, "i1")) + step.zero
            zeros.append(getattr(step, "zero", 0))
            made.append(
                np.clip(value, -128, 127) if isinstance(step, IntegerConvolution) else value
            )
        elif isinstance(step, IntegerPool):
            made.append(windows_of(made[step.given], step.windows, -128).max(axis=(3, 4)))
            zeros.append(zeros[step.given])
        elif isinstance(step, IntegerSum):
            one = (made[step.first] - zeros[step.first]) * step.factors[0]
            two = (made[step.second] - zeros[step.second]) * step.factors[1]
            made.append(np.clip(nearest(one + two, step.shift) + step.zero, -128, 127))
            zeros.append(step.zero)
        else:
            made.append(_joined(step, made, zeros))
            zeros.append(step.zero)
    return made


def _joined(step: IntegerJoin, made: list[np.ndarray], zeros: list[int]) -> np.ndarray:
    parts = []
    for part in step.parts:
        given, s = made[part.given], part.fold
        n, rows, columns, channels = given.shape
        if s > 1:
            as_if = given.transpose(0, 3, 1, 2).reshape(n, channels // s**2, rows, s, columns, s)
            folded = as_if.transpose(0, 3, 5, 1, 2, 4).reshape(n, -1, rows // s, columns // s)
            given = folded.transpose(0, 2, 3, 1)
        given = np.kron(given, np.ones((1, part.repeat, part.repeat, 1), np.int64))
        value = nearest((given - zeros[part.given]) * part.factor, part.shift)
        parts.append(np.clip(value + step.zero, -128, 127))
    return np.concatenate(parts, axis=3)
