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
from twin.road.opendrive.check_network import network_mistakes
from twin.road.opendrive.reading.load import load_network
from twin.road.opendrive.records import RoadNetwork
from twin.world.apart.checks import Array
from twin.world.apart.parser import Parser
from twin.world.apart.reading import AskedFile, path_apart, read_apart

NETWORK_BYTES_MAX = 256 << 20
"""Largest answer of a road file [bytes]."""
MEMORY_BYTES_MAX = 8 << 30
"""Address space of the process that reads one [bytes]."""
CPU_S = 120
"""Processor time that it may take [s]."""
WALL_S = 600.0
"""Time until it is given up, however busy the machine is [s]."""

NETWORK = Parser(
    "twin.road.opendrive.apart:network_bytes",
    Array("uint8", ("n",), side_max=NETWORK_BYTES_MAX),
    "cannot be read as roads",
)
_NETWORK = f"{__name__}:NETWORK"


def network_apart(path: Path) -> RoadNetwork:
    """:func:`twin.road.opendrive.reading.load.load_network` in a process apart.

    Raises:
        ValueError: as there; or the process came to no answer, or to a wrong one; one line.
        InfrastructureError: the process did not start.
    """
    limits = {"cpu_s": CPU_S, "wall_s": WALL_S, "memory_bytes": MEMORY_BYTES_MAX}
    answers = read_apart(
        [AskedFile(_NETWORK, path)], answer_bytes=NETWORK_BYTES_MAX + (1 << 20), **limits
    )
    with closing(answers):
        return named_as_given(decode_network(next(answers), path), path)


def network_bytes(path: Path) -> np.ndarray:
    """The answer of the process: the records of a road file as MessagePack, uint8 [n].

    Raises:
        ValueError: as :func:`twin.road.opendrive.reading.load.load_network`; or it is too large.
    """
    data = msgspec.msgpack.encode(load_network(path))
    if len(data) > NETWORK_BYTES_MAX:
        words = f"its records take {len(data)} bytes, at most {NETWORK_BYTES_MAX} are taken"
        raise ValueError(f"{path}: {words}; use a part of it")
    return np.frombuffer(data, np.uint8)


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


def named_as_given(network: RoadNetwork, path: Path) -> RoadNetwork:
    """The network with the name of its file as the user gave it, notes escaped."""
    seen = str(path_apart(path))
    notes = tuple(escape(note.replace(seen, str(path))) for note in network.notes)
    return replace(network, file=str(path), notes=notes)


@cache
def _decoder() -> msgspec.msgpack.Decoder[RoadNetwork]:
    return msgspec.msgpack.Decoder(RoadNetwork)
