"""Darknet's ``.weights``: a header, then float32 of every convolution in the order of the cfg.

Header: major, minor, revision (int32 each), then the number of images seen in training: int64 from
version 0.2 on, int32 before. Per convolution: biases, then with batch normalisation scales, means
and variances, then the kernels. All little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from devkit.darknet.network import Convolutional, DarknetNetwork
from devkit.darknet.sections import DarknetError
from schemas.files.assets import FILE_BYTES_MAX
from schemas.files.regular_file import open_regular


@dataclass(frozen=True, slots=True, eq=False)
class Convolution:
    """The numbers of one convolutional layer with F filters, float32."""

    kernels: np.ndarray
    """[F, channels / groups, size, size]."""
    biases: np.ndarray
    """Biases of the filters [F]."""
    scales: np.ndarray | None = None
    """Factors of the filters [F]; None without batch normalisation, like the next two."""
    means: np.ndarray | None = None
    variances: np.ndarray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Weights:
    """A weights file."""

    version: tuple[int, int, int]
    seen: int
    """Images seen in training."""
    convolutions: Mapping[int, Convolution]
    """Convolutions by layer index."""


def float_count(layer: Convolutional) -> int:
    """Numbers that a weights file holds for a layer."""
    return _kernel_count(layer) + layer.shape.channels * (4 if layer.batch_normalize else 1)


def read_weights(path: Path, network: DarknetNetwork) -> Weights:
    """The weights of ``network``; they must fill the file exactly.

    Raises:
        DarknetError: the file cannot be read, is too short or too long for the network, or holds
            something that is no finite number; the line names the layer.
    """
    try:
        with open_regular(path, FILE_BYTES_MAX) as stream:
            data = np.fromfile(stream, np.uint8)
    except OSError as error:
        raise DarknetError(f"{path}: {error.strerror or error}") from None
    version, seen, offset = _read_header(path, data)
    body = data[offset : offset + (data.size - offset) // 4 * 4].view("<f4")
    convolutions = {}
    position = 0
    for layer in network.convolutions():
        needed = float_count(layer)
        if body.size - position < needed:
            raise DarknetError(
                f"{path}: ends in {layer.label}, line {layer.line} of {network.name}: it needs"
                f" {4 * needed} bytes, {data.size - offset - 4 * position} are left;"
                " truncated, or of another cfg"
            )
        convolutions[layer.index] = _split(path, layer, body[position : position + needed])
        position += needed
    left = data.size - offset - 4 * position
    if left:
        last = network.convolutions()[-1] if network.convolutions() else network.layers[-1]
        raise DarknetError(
            f"{path}: {left} bytes are left behind the last one, {last.label}, of {network.name};"
            " weights of another cfg?"
        )
    return Weights(version, seen, convolutions)


def write_weights(path: Path, network: DarknetNetwork, weights: Weights) -> None:
    """Write a file that :func:`read_weights` and Darknet read."""
    major, minor, revision = weights.version
    long = major * 10 + minor >= 2
    with path.open("wb") as stream:
        stream.write(struct.pack("<iii", major, minor, revision))
        stream.write(struct.pack("<q" if long else "<i", weights.seen))
        for layer in network.convolutions():
            numbers = weights.convolutions[layer.index]
            parts = [numbers.biases]
            if layer.batch_normalize:
                parts += [
                    p for p in (numbers.scales, numbers.means, numbers.variances) if p is not None
                ]
            for part in (*parts, numbers.kernels):
                stream.write(np.ascontiguousarray(part, "<f4").tobytes())


def _read_header(path: Path, data: np.ndarray) -> tuple[tuple[int, int, int], int, int]:
    """Version, images seen, and where the numbers begin [bytes]."""
    if data.size < 16:
        raise DarknetError(f"{path}: {data.size} bytes, no Darknet header (at least 16)")
    head = data[:20].tobytes()
    major, minor, revision = struct.unpack_from("<iii", head)
    if not (0 <= major < 1000 and 0 <= minor < 1000):
        raise DarknetError(f"{path}: version {major}.{minor} in the header; no Darknet weights")
    if major * 10 + minor < 2:
        return (major, minor, revision), struct.unpack_from("<i", head, 12)[0], 16
    if data.size < 20:
        raise DarknetError(f"{path}: {data.size} bytes, ends in the header (20)")
    return (major, minor, revision), struct.unpack_from("<q", head, 12)[0], 20


def _kernel_count(layer: Convolutional) -> int:
    return layer.shape.channels * (layer.channels // layer.groups) * layer.size**2


def _split(path: Path, layer: Convolutional, numbers: np.ndarray) -> Convolution:
    if not np.isfinite(numbers).all():
        raise DarknetError(f"{path}: {layer.label} holds numbers that are not finite; damaged")
    filters = layer.shape.channels
    kernels = numbers[numbers.size - _kernel_count(layer) :].reshape(
        filters, layer.channels // layer.groups, layer.size, layer.size
    )
    if not layer.batch_normalize:
        return Convolution(kernels, numbers[:filters])
    biases, scales, means, variances = numbers[: 4 * filters].reshape(4, filters)
    if variances.min() < 0:
        raise DarknetError(f"{path}: {layer.label} has a negative variance; of another cfg?")
    return Convolution(kernels, biases, scales, means, variances)
