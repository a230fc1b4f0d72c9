"""Files of integer networks: MessagePack of :class:`devkit.detector.integer.steps.IntegerNetwork`.

Nothing in a file is executed, and what a kernel would rely on is checked when it is read.
"""

from __future__ import annotations

from pathlib import Path

import msgspec

from devkit.detector.description import DetectorDescription, decode_description
from devkit.detector.integer.shapes import LevelShape, map_shapes
from devkit.detector.integer.steps import IntegerNetwork
from devkit.detector.runtime import ModelError, first_line
from schemas.files.regular_file import read_regular

SUFFIX = ".integer"
"""Ending of such files."""

FILE_BYTES_MAX = 256 << 20
"""Largest file [bytes]."""


def encode_network(network: IntegerNetwork) -> bytes:
    """The file's content."""
    return msgspec.msgpack.encode(network)


def read_network(path: Path) -> tuple[IntegerNetwork, DetectorDescription, list[LevelShape]]:
    """A file's network, the description of the detector and the shapes of all maps.

    Raises:
        ModelError: it is missing, damaged or would not stay within its maps; one line naming it.
    """
    try:
        data = read_regular(path, FILE_BYTES_MAX)
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror or error}") from None
    try:
        network = msgspec.msgpack.decode(data, type=IntegerNetwork)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        reason = first_line(error)
        raise ModelError(f"{path}: not an integer network, or damaged: {reason}") from None
    try:
        description = decode_description(network.description, "description")
        return network, description, map_shapes(network, description)
    except ValueError as error:
        raise ModelError(f"{path}: damaged: {error}") from None
