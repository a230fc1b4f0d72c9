"""What the process apart answers of a road file (:mod:`twin.road.opendrive.apart`)."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np

from twin.road.opendrive.reading.load import load_network
from twin.world.apart.checks import Array
from twin.world.apart.parser import Parser

NETWORK_BYTES_MAX = 256 << 20
"""Largest answer of a road file [bytes]."""

NETWORK = Parser(
    "twin.road.opendrive.reading.answer:network_bytes",
    Array("uint8", ("n",), side_max=NETWORK_BYTES_MAX),
    "cannot be read as roads",
)


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
