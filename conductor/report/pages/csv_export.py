"""A campaign as CSV files, of any scenario: a table of the cases, and the KPI rows of each."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pa_csv

from conductor.records.fingerprint import committed_rows
from conductor.report.pages.summary import CSV_FILE, flat, inert, summary_table
from conductor.report.reading.dossier import open_dossier
from twin.base.errors import UsageError, storage_error
from twin.base.files import write_atomic
from twin.base.progress import steps


def export_csv(folder: Path, out: Path) -> list[Path]:
    """Write ``summary.csv`` and, per case with KPI rows, ``CASE.csv`` of the campaign ``folder`` to
    ``out``; detections are JSON. Returns the files, the summary last.

    Raises:
        UsageError: no campaign was run in ``folder``, or ``out`` holds something; one line.
        InfrastructureError: files are damaged, or the disk lets us down.
    """
    dossier = open_dossier(folder)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UsageError(f"{out}: exists and is not an empty folder; give another one with --out")
    files = []
    try:
        out.mkdir(parents=True, exist_ok=True)
        for row in steps("cases", dossier.rows):
            if row.end.kpi_sha256:
                table = committed_rows(folder, row.case.id, row.end)[0]
                files.append(_written(out / f"{row.case.id}.csv", _plain(table)))
        files.append(_written(out / CSV_FILE, flat(summary_table(dossier))))
    except OSError as error:
        raise storage_error(error, str(error.filename or out)) from None
    return files


def _plain(table: pa.Table) -> pa.Table:
    """CSV has no lists, and spreadsheets take some texts for formulas."""
    for index, field in enumerate(table.schema):
        values = table.column(index)
        if pa.types.is_list(field.type):
            texts = [None if v is None else json.dumps(v) for v in values.to_pylist()]
        elif pa.types.is_string(field.type):
            texts = [inert(text) for text in values.to_pylist()]
        else:
            continue
        table = table.set_column(index, field.name, pa.array(texts, pa.string()))
    return table


def _written(path: Path, table: pa.Table) -> Path:
    data = io.BytesIO()
    pa_csv.write_csv(table, data)
    write_atomic(path, data.getvalue(), sync=False)
    return path
