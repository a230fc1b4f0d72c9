"""Folders of earlier versions, whose KPI files have fewer columns, are read by every command."""

from __future__ import annotations

import hashlib
from pathlib import Path

import msgspec
import pyarrow.parquet as pq
from unit.conductor.report.synthetic_campaign import make_campaign

from conductor.records.fingerprint import fingerprint
from conductor.records.outcomes import encode_outcomes, read_outcomes
from conductor.report import make_report, report_json
from conductor.report.autodrive.export import export_autodrive
from conductor.report.compare.folders import compare_folders
from schemas.files.kpi import NAMES
from twin.records.kpi_file import COLUMNS_MIN, canonical, read_kpi


def _older(folder: Path) -> None:
    """The folder as a version without the columns about what is nearest left it."""
    outcomes = read_outcomes(folder)
    ends = {}
    for name, end in outcomes.cases.items():
        path = folder / end.attempt_dir / "kpi.parquet"
        table = read_kpi(path)
        pq.write_table(table.select(table.column_names[:COLUMNS_MIN]), path)
        digest = hashlib.sha256(b"".join(canonical(read_kpi(path)))).hexdigest()
        known = {n: v for n, v in end.scalars.items() if not n.startswith(("nearest", "hit"))}
        ends[name] = msgspec.structs.replace(end, kpi_sha256=digest, scalars=known)
    changed = msgspec.structs.replace(outcomes, cases=ends)
    (folder / "outcomes.json").write_bytes(encode_outcomes(changed))


def test_report_compare_fingerprint_and_export_read_them(tmp_path: Path) -> None:
    make_campaign(tmp_path / "old")
    make_campaign(tmp_path / "new")
    _older(tmp_path / "old")
    made = make_report(tmp_path / "old", plots=False)
    assert made.content.evidence.alarms == []
    assert made.content.evidence.fingerprint == fingerprint(tmp_path / "old")
    case = report_json(tmp_path / "old")["cases"][0]
    assert case["nearest_min_m"] is None
    assert [case[column.name] for column in NAMES] == [None] * len(NAMES)
    found = compare_folders(tmp_path / "old", tmp_path / "new")
    assert (found.pairs, found.flips, found.same_bytes) == (8, [], 0)
    assert len(export_autodrive(tmp_path / "old", tmp_path / "out").files) == 9
