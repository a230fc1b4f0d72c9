"""``summary.parquet`` and ``summary.csv``: one row per case, for programs."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from conductor.report.reading.axes import LEFT_OUT, PLAIN, axis_value, further_axes
from conductor.report.reading.dossier import Dossier, open_dossier
from schemas.files.kpi import NAMES
from schemas.wire.realtime import Realtime
from twin.base.errors import storage_error
from twin.base.files import write_atomic

SUMMARY_FILE = "summary.parquet"
CSV_FILE = "summary.csv"

_PLAIN_TYPES = {"repeat": pa.int64(), "batch": pa.int64()}
_SCALAR_TYPES = {"float64": pa.float64(), "int32": pa.int32()}


def write_summary(folder: Path) -> pa.Table:
    """Write both files into the campaign ``folder``; returns the table.

    One row per case in campaign order: id, axes, outcome, verdict, ``passed`` and
    ``no_collision`` (null without a verdict: missing is never a pass), reasons, the scalars of
    the scenario's cases, :data:`schemas.files.kpi.NAMES`, and where the
    result came from.

    Raises:
        UsageError: no campaign was run here, or nothing was simulated in it.
        InfrastructureError: files are damaged, or the disk lets us down.
    """
    return write_summary_of(open_dossier(folder))


def write_summary_of(dossier: Dossier) -> pa.Table:
    """Write the summary as :func:`write_summary` does, for a folder that has been read already."""
    table = summary_table(dossier)
    parquet = io.BytesIO()
    pq.write_table(table, parquet, compression="zstd")
    text = io.BytesIO()
    pa_csv.write_csv(flat(table), text)
    for name, data in ((SUMMARY_FILE, parquet), (CSV_FILE, text)):
        path = dossier.folder / name
        try:
            write_atomic(path, data.getvalue())
        except OSError as error:
            raise storage_error(error, str(path)) from None
    return table


def summary_table(dossier: Dossier) -> pa.Table:
    """The table of :func:`write_summary`."""
    rows = dossier.rows
    names: list[str] = []
    columns: list[pa.Array] = []

    def add(name: str, values: list[Any], type_: pa.DataType | None) -> None:
        names.append(name)
        columns.append(pa.array(values, type_))

    def text(name: str, values: list[str]) -> None:
        add(name, [value or None for value in values], pa.string())

    add("case", [row.case.id for row in rows], pa.string())
    for axis in PLAIN:
        values = [axis_value(row.case, axis) for row in rows]
        add(axis, values, _PLAIN_TYPES.get(axis, pa.string()))
        if axis == "model":
            kinds = [str(row.case.variation.perception.__struct_config__.tag) for row in rows]
            add("perception", kinds, pa.string())
    for axis in further_axes(dossier.campaign):
        add(axis, _of_one_type([axis_value(row.case, axis) for row in rows]), None)
    text("outcome", [row.end.outcome for row in rows])
    text("verdict", [row.end.verdict for row in rows])
    add("passed", [row.passed for row in rows], pa.bool_())
    add("no_collision", [row.no_collision for row in rows], pa.bool_())
    add("reasons", [row.end.reasons for row in rows], pa.list_(pa.string()))
    for column in dossier.scalars:
        values = [row.scalar(column.name) for row in rows]
        add(column.name, values, _SCALAR_TYPES[column.type])
    for column in NAMES:
        text(column.name, [row.end.names.get(column.name, "") for row in rows])
    if dossier.campaign.clock == "realtime":
        for name in Realtime.__struct_fields__:
            values = [row.end.realtime and getattr(row.end.realtime, name) for row in rows]
            add(f"realtime_{name}", values, None)
    ran = dossier.imported is None
    add("attempts", [row.end.attempts if ran else None for row in rows], pa.int64())
    for name in ("attempt_dir", "kpi_sha256", "device_class", "worker"):
        text(name, [getattr(row.end, name) for row in rows])
    # Only a committed attempt has a wall time; 0 stands for "none" in the outcomes.
    add("wall_s", [row.end.wall_s if row.end.attempt else None for row in rows], pa.float64())
    return pa.table(columns, names=names)


def flat(table: pa.Table) -> pa.Table:
    """CSV has no lists: reasons become one text. Spreadsheets take some texts for formulas."""
    index = table.schema.get_field_index("reasons")
    joined = ["; ".join(reasons) for reasons in table.column("reasons").to_pylist()]
    table = table.set_column(index, "reasons", pa.array(joined, pa.string()))
    for index, field in enumerate(table.schema):
        if pa.types.is_string(field.type):
            plain = [inert(text) for text in table.column(index).to_pylist()]
            table = table.set_column(index, field.name, pa.array(plain, pa.string()))
    return table.rename_columns([inert(name) or "" for name in table.column_names])


_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")


def inert(text: str | None) -> str | None:
    """``text`` so that no spreadsheet runs it: an apostrophe before what would be a formula."""
    return f"'{text}" if text is not None and text.startswith(_FORMULA) else text


def _of_one_type(values: list[Any]) -> list[Any]:
    """Values of an axis for a column: nothing where it is left out, and texts where a parameter has
    values of several types."""
    cells = [None if value in LEFT_OUT else value for value in values]
    types = {type(value) for value in cells if value is not None}
    if len(types) < 2 or types == {int, float}:
        return cells
    return [None if value is None else str(value) for value in cells]
