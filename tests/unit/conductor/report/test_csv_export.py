"""``conductor export --format csv``: the rows of each case, and a summary."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from unit.conductor.report.synthetic_campaign import make_campaign

from conductor.report.pages.csv_export import export_csv
from schemas.files.kpi import KPI_COLUMNS
from schemas.plan import expand
from twin.base.errors import UsageError
from twin.records.kpi_file import read_kpi


def test_every_case_has_its_rows_and_missing_is_empty(tmp_path: Path) -> None:
    campaign, outcomes = make_campaign(tmp_path / "run")
    cases = [case.id for case in expand(campaign)]
    files = export_csv(tmp_path / "run", tmp_path / "out")
    assert [path.name for path in files] == [*(f"{name}.csv" for name in cases), "summary.csv"]
    table = read_kpi(tmp_path / "run" / outcomes.cases[cases[0]].attempt_dir / "kpi.parquet")
    with files[0].open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [column.name for column in KPI_COLUMNS]
    assert len(rows) == table.num_rows
    for row, expected in zip(rows, table.to_pylist(), strict=True):
        assert float(row["speed_mps"]) == expected["speed_mps"]
        assert (row["brake"] == "") == (expected["brake"] is None)
        if expected["detections"] is not None:
            assert json.loads(row["detections"]) == expected["detections"]
    assert files[-1].read_text().count("\n") == len(cases) + 1


def test_a_folder_that_holds_something_is_refused(tmp_path: Path) -> None:
    make_campaign(tmp_path / "run")
    with pytest.raises(UsageError, match="exists and is not an empty folder"):
        export_csv(tmp_path / "run", tmp_path / "run")
