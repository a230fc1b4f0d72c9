"""Road networks of files that others wrote, read by a process apart (:mod:`twin.world.apart`).

The process sees the road file alone. It answers records as MessagePack, which are checked by their
types and then by :mod:`twin.road.opendrive.check_network`.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from functools import cache
from pathlib import Path

import msgspec
import numpy as np

from schemas.escape import escape
from schemas.files.regular_file import open_regular
from twin.road.opendrive.check_network import network_mistakes
from twin.road.opendrive.reading.answer import NETWORK, NETWORK_BYTES_MAX
from twin.road.opendrive.reading.reader import FILE_BYTES_MAX
from twin.road.opendrive.records import RoadNetwork
from twin.world.apart.reading import AskedFile, path_apart, read_apart, unprotected

MEMORY_BYTES_MAX = 8 << 30
"""Address space of the process that reads one [bytes]."""
CPU_S = 120
"""Processor time that it may take [s]."""
WALL_S = 600
"""Time until it is given up, however busy the machine is [s]."""

_NETWORK = "twin.road.opendrive.reading.answer:NETWORK"


def network_apart(path: Path) -> RoadNetwork:
    """:func:`twin.road.opendrive.reading.load.load_network` in a process apart.

    Raises:
        ValueError: as there; or the process came to no answer, or to a wrong one; one line.
        InfrastructureError: the process did not start.
    """
    try:
        open_regular(path, FILE_BYTES_MAX).close()
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from None
    limits = {"cpu_s": CPU_S, "wall_s": WALL_S, "memory_bytes": MEMORY_BYTES_MAX}
    answers = read_apart(
        [AskedFile(_NETWORK, path)], answer_bytes=NETWORK_BYTES_MAX + (1 << 20), **limits
    )
    with closing(answers):
        network = decode_network(next(answers), path)
    place = str(path_apart(path))
    notes = tuple(escape(note.replace(place, str(path))) for note in network.notes)
    return replace(network, file=str(path), notes=notes)


def notes_of_reading() -> tuple[str, ...]:
    """How scenario and road files are read on this machine, if that is worth a line."""
    words = unprotected("scenario and road files")
    return (words,) if words else ()


def decode_network(data: np.ndarray, path: Path) -> RoadNetwork:
    """The network that a process has answered.

    Args:
        data: its answer, uint8 [n].
        path: the file, for messages.

    Raises:
        ValueError: it is none; one line.
    """
    try:
        network = _decoder().decode(data.data)
    except (msgspec.DecodeError, RecursionError) as error:
        words = f"{NETWORK.failed}: its reader answered {str(error)[:200]}"
        raise ValueError(escape(f"{path}: {words}")) from None
    mistakes = network_mistakes(network)
    if mistakes:
        words = f"{NETWORK.failed}: its reader answered a network that is none: {mistakes[0]}"
        raise ValueError(escape(f"{path}: {words}"))
    return network


@cache
def _decoder() -> msgspec.msgpack.Decoder[RoadNetwork]:
    return msgspec.msgpack.Decoder(RoadNetwork)
