"""The canonical byte stream of KPI values, of which digests and fingerprints are taken.

It knows no file format: :mod:`twin.records.kpi_file` feeds it from Arrow tables,
:mod:`twin.kpi.rows_file` from the rows of a case that has just ended.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from schemas.files.kpi import DETECTION_FIELDS
from schemas.kinds.kpi import KpiKind

_INTEGERS = {"bool": "u1", "int32": "<i4", "int64": "<i8"}


def column_head(column: KpiKind, valid: NDArray[np.bool_]) -> bytes:
    """Begin a column: its name, type and validity [rows]."""
    parts = (column.name.encode(), column.type.encode(), valid.astype("u1").tobytes())
    return b"".join(map(_prefixed, parts))


def number_values(column: KpiKind, values: NDArray[np.generic]) -> bytes:
    """Values of a column of numbers or truth values [rows], 0 where missing."""
    if column.type == "float64":
        return _prefixed(_floats(values))
    return _prefixed(values.astype(_INTEGERS[column.type]).tobytes())


def name_values(names: Sequence[str]) -> bytes:
    """Values of a column of names [rows], empty where missing."""
    prefixed = {name: _prefixed(name.encode()) for name in set(names)}
    return b"".join([prefixed[name] for name in names])


def detection_values(
    lengths: NDArray[np.integer], labels: Sequence[str], numbers: Mapping[str, NDArray[np.generic]]
) -> Iterator[bytes]:
    """Values of the column of detections.

    Args:
        lengths: detections of each row, 0 where missing [rows].
        labels: of all detections, row after row [n].
        numbers: their other fields by name, each [n].
    """
    yield _prefixed(lengths.astype("<i4").tobytes())
    for name in DETECTION_FIELDS:
        yield name_values(labels) if name == "label" else _prefixed(_floats(numbers[name]))


def _floats(values: NDArray[np.generic]) -> bytes:
    """Little-endian, every NaN in one pattern."""
    floats = np.array(values, dtype="<f8")
    floats[np.isnan(floats)] = np.nan
    return floats.tobytes()


def _prefixed(data: bytes) -> bytes:
    return struct.pack("<Q", len(data)) + data
