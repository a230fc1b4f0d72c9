"""KPI Parquet files and their canonical byte stream.

Fingerprints are over values, not over Parquet bytes: those differ with writer version and chunking.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from schemas.escape import escape
from schemas.files.kpi import DETECTION_FIELDS, KPI_COLUMNS
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular
from schemas.kinds.kpi import KpiKind, columns_by_name
from twin.base.errors import InfrastructureError, storage_error
from twin.base.files import write_atomic
from twin.records.kpi_stream import column_head, detection_values, name_values, number_values

_DETECTION = pa.struct(
    [(f, pa.string() if f == "label" else pa.float64()) for f in DETECTION_FIELDS]
)
_TYPES = {
    "bool": pa.bool_(),
    "int32": pa.int32(),
    "int64": pa.int64(),
    "float64": pa.float64(),
    "detections": pa.list_(_DETECTION),
    "name": pa.string(),
}


def _field(column: KpiKind) -> pa.Field:
    about = {"unit": column.unit, "doc": column.doc}
    return pa.field(column.name, _TYPES[column.type], column.nullable, about)


KPI_SCHEMA = pa.schema([_field(column) for column in KPI_COLUMNS])
"""Arrow schema of ``kpi.parquet``, as far as all cases have it: behind these columns are those of
the scenario's family, if it has some (:attr:`schemas.kinds.scenario.ScenarioKind.columns`)."""
COLUMNS_MIN = KPI_SCHEMA.get_field_index("detections") + 1
"""Columns of the first version; later versions have more behind them."""


def kpi_table(columns: dict[str, list[Any]]) -> pa.Table:
    """Columns of Python values (None: missing) -> Arrow table in :data:`KPI_SCHEMA`. Nullable
    columns may be left out: all their values are missing."""
    missing = [None] * len(columns["tick"])
    declared = columns_by_name()
    kinds = [*KPI_COLUMNS, *(declared[n] for n in columns if n not in KPI_SCHEMA.names)]
    values = [columns.get(c.name, missing) if c.nullable else columns[c.name] for c in kinds]
    arrays = [pa.array(v, _TYPES[c.type]) for v, c in zip(values, kinds, strict=True)]
    return pa.table(arrays, schema=pa.schema([_field(kind) for kind in kinds]))


def write_kpi(table: pa.Table, path: Path) -> None:
    """Write KPI rows atomically: the file is complete or absent."""
    data = io.BytesIO()
    pq.write_table(table, data, compression="zstd")
    try:
        write_atomic(path, data.getbuffer())
    except OSError as error:
        raise storage_error(error, str(path)) from None


def read_kpi(path: Path) -> pa.Table:
    """Read ``kpi.parquet``, of this version or an earlier one, which has fewer columns.

    Raises:
        InfrastructureError: missing, damaged, or with other columns.
    """
    try:
        # Half the time of `read_table`, which is made for many large files.
        with pq.ParquetFile(pa.BufferReader(read_regular(path, RUN_FILE_BYTES_MAX))) as file:
            table = file.read(use_threads=False)
    except (OSError, ValueError, pa.ArrowException) as error:  # of text that is none, ValueError
        raise InfrastructureError(f"{path}: {escape(' '.join(str(error).split()))}") from None
    if not _is_known(table.schema):
        raise InfrastructureError(
            f"{path}: not the KPI columns of this version and of the installed distributions"
        )
    # Which columns may be missing has changed between versions; no value has.
    schema = pa.schema([_field(columns_by_name()[name]) for name in table.column_names])
    return table if table.schema.equals(schema) else table.cast(schema)


def _is_known(schema: pa.Schema) -> bool:
    """Whether these are the columns of a version so far, this one's or the first of them; behind
    all of this one's, columns of families."""
    if len(schema) < COLUMNS_MIN or len(set(schema.names)) < len(schema):
        return False
    columns = [(f.name, f.type) for f in schema]
    first = [(f.name, f.type) for f in KPI_SCHEMA][: len(columns)]
    known = {column.name: _TYPES[column.type] for column in columns_by_name().values()}
    return columns[: len(first)] == first and all(
        known.get(n) == t for n, t in columns[len(first) :]
    )


def read_kpi_columns(path: Path, names: Sequence[str]) -> pa.Table:
    """Some columns of a ``kpi.parquet``, of this version or another, for those who only look.

    Raises:
        InfrastructureError: missing, damaged, or without these columns in their types.
    """
    try:
        table = pq.read_table(path, columns=list(names))
    except (OSError, ValueError, pa.ArrowException) as error:  # of text that is none, ValueError
        raise InfrastructureError(f"{path}: {escape(' '.join(str(error).split()))}") from None
    columns = {field.name: field.type for field in table.schema}
    if columns != {name: _TYPES[columns_by_name()[name].type] for name in names}:
        raise InfrastructureError(f"{path}: without the KPI columns {', '.join(names)}")
    return table


def canonical(table: pa.Table, names: Sequence[str] = ()) -> Iterator[bytes]:
    """Byte stream of the values: per column in schema order its name, type, validity, offsets and
    little-endian values, missing values and NaN in one pattern each. Without ``names`` of all
    columns. Columns that an earlier version did not have are left out: its files keep their stream.
    """
    for column in (columns_by_name()[name] for name in table.column_names):
        if names and column.name not in names:
            continue
        data = table.column(column.name).combine_chunks()
        if isinstance(data, pa.ChunkedArray):  # no rows
            data = pa.array([], _TYPES[column.type])
        yield column_head(column, data.is_valid().to_numpy(zero_copy_only=False))
        yield from _values(data, column)


def kpi_sha256(table: pa.Table) -> str:
    """SHA-256 of :func:`canonical`, hexadecimal."""
    sha = hashlib.sha256()
    for part in canonical(table):
        sha.update(part)
    return sha.hexdigest()


def _values(data: pa.Array, column: KpiKind) -> Iterator[bytes]:
    if column.type == "detections":
        lengths = data.value_lengths().fill_null(0).to_numpy(zero_copy_only=False)
        rows = data.flatten()
        numbers = {
            name: rows.field(name).to_numpy(zero_copy_only=False)
            for name in DETECTION_FIELDS
            if name != "label"
        }
        yield from detection_values(lengths, rows.field("label").to_pylist(), numbers)
    elif column.type == "name":
        yield name_values(data.fill_null("").to_pylist())
    else:
        filled = data.fill_null(False if column.type == "bool" else 0)
        yield number_values(column, filled.to_numpy(zero_copy_only=False))
