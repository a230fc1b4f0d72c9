"""A road network from a file."""

from __future__ import annotations

from pathlib import Path

from schemas.files.regular_file import read_regular
from twin.road.opendrive.reading.reader import FILE_BYTES_MAX, read_network
from twin.road.opendrive.records import RoadNetwork


def load_network(path: Path) -> RoadNetwork:
    """The roads and junctions of an OpenDRIVE file.

    Raises:
        ValueError: it cannot be read or used; one line with file, line and element.
    """
    try:
        data = read_regular(path, FILE_BYTES_MAX)
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from None
    return read_network(data, str(path))
