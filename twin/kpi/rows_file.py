"""Writes the rows of a case that has ended as ``kpi.parquet``, and gives their digest.

Simulators write with ``arro3``, an Arrow library that loads in a tenth of the time of pyarrow and
takes a fifth of its space; workers need no other. Those who read KPI files use
:mod:`twin.records.kpi_file`, which gives the same digest for the same values.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from arro3.core import Array, DataType, Field, Schema, Table, list_array, struct_array
from arro3.io import write_parquet

from schemas.files.kpi import DETECTION_FIELDS, KPI_COLUMNS
from schemas.kinds.kpi import KpiKind, columns_by_name
from twin.base.errors import storage_error
from twin.base.files import write_atomic
from twin.kpi.table import DetectionColumn, KpiColumn, KpiTable
from twin.records.kpi_stream import column_head, detection_values, name_values, number_values

_TEXT, _NUMBER = DataType.string(), DataType.float64()
_DETECTION = [Field(name, _TEXT if name == "label" else _NUMBER) for name in DETECTION_FIELDS]
_TYPES = {
    "bool": DataType.bool(),
    "int32": DataType.int32(),
    "int64": DataType.int64(),
    "float64": _NUMBER,
    "detections": DataType.list(Field("element", DataType.struct(_DETECTION))),
    "name": _TEXT,
}


def write_rows(table: KpiTable, path: Path) -> None:
    """Write KPI rows atomically: the file is complete or absent.

    Raises:
        TwinError: the folder cannot be written (disk full, no permission).
    """
    fields, arrays = [], []
    for kind in _kinds(table):
        about = {"unit": kind.unit, "doc": kind.doc}
        fields.append(Field(kind.name, _TYPES[kind.type], kind.nullable, metadata=about))
        if kind.type == "detections":
            arrays.append(_detections(table.detections))
        else:
            arrays.append(_array(kind, table.columns[kind.name]))
    data = io.BytesIO()
    rows = Table.from_arrays(arrays, schema=Schema(fields))
    write_parquet(rows, data, compression="zstd(1)")
    try:
        write_atomic(path, data.getbuffer())
    except OSError as error:
        raise storage_error(error, str(path)) from None


def rows_sha256(table: KpiTable) -> str:
    """SHA-256 of the canonical stream of the values, hexadecimal; that of
    :func:`twin.records.kpi_file.kpi_sha256` for the file's table."""
    sha = hashlib.sha256()
    for part in _canonical(table):
        sha.update(part)
    return sha.hexdigest()


def _kinds(table: KpiTable) -> list[KpiKind]:
    """The file's columns, in order: those of all cases, then those of the scenario's family."""
    declared = columns_by_name()
    common = {column.name for column in KPI_COLUMNS}
    return [*KPI_COLUMNS, *(declared[name] for name in table.columns if name not in common)]


def _canonical(table: KpiTable) -> Iterator[bytes]:
    for kind in _kinds(table):
        if kind.type == "detections":
            detections = table.detections
            yield column_head(kind, detections.valid)
            numbers = {n: getattr(detections, n) for n in DETECTION_FIELDS if n != "label"}
            yield from detection_values(np.diff(detections.offsets), detections.label, numbers)
            continue
        column = table.columns[kind.name]
        valid = np.ones(table.rows, np.bool_) if column.valid is None else column.valid
        yield column_head(kind, valid)
        if kind.type == "name":
            yield name_values(column.values.tolist())
        else:
            yield number_values(kind, column.values)


def _array(kind: KpiKind, column: KpiColumn) -> Array:
    values = column.values.tolist()
    if column.valid is not None:
        values = [v if ok else None for v, ok in zip(values, column.valid.tolist(), strict=True)]
    return Array(values, _TYPES[kind.type])


def _detections(detections: DetectionColumn) -> Array:
    children = [
        Array(list(getattr(detections, field.name)), field.type)  # floats of NumPy are floats
        for field in _DETECTION
    ]
    return list_array(
        Array(detections.offsets.tolist(), DataType.int32()),
        struct_array(children, fields=_DETECTION),
        type=_TYPES["detections"],
        mask=Array((~detections.valid).tolist(), DataType.bool()),
    )
