"""Export in the layout of the AutoDRIVE study: what a notebook reads, and what comes back."""

from __future__ import annotations

import csv
import hashlib
import json
from pathlib import Path
from typing import Any

import msgspec
import pytest
from unit.conductor.report.autodrive_logs import write_logs
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign

from conductor.records.fingerprint import fingerprint
from conductor.report import report_json
from conductor.report.autodrive.export import export_autodrive
from conductor.report.autodrive.importing import import_autodrive
from conductor.report.autodrive.layout import STEERING_MAX_RAD
from schemas.files.autodrive_log import COLUMNS
from schemas.files.kpi import DETECTION_FIELDS
from twin.base.errors import InfrastructureError, UsageError
from twin.records.kpi_file import kpi_sha256, kpi_table, read_kpi, write_kpi

replace = msgspec.structs.replace
BOTH_HOLD = (
    *("case", "model", "time_of_day", "weather", "batch", "status", "verdict", "passed"),
    *("dtc_min_m", "dtc_end_m", "aeb_time_s", "aeb_dtc_m", "collisions", "sim_time_s", "ticks"),
)
"""Columns of a case that the layout has a place for."""


def held(folder: Path) -> dict[str, Any]:
    """What the layout holds of a report."""
    tables = report_json(folder)
    return {
        "cases": [{name: case[name] for name in BOTH_HOLD} for case in tables["cases"]],
        "systems": [
            {k: line[k] for k in ("model", "batches", "passed", "total", "counts", "stops_m")}
            for line in tables["systems"]
        ],
        "findings": tables["findings"],
    }


def test_a_campaign_comes_back_as_it_was(tmp_path: Path) -> None:
    data = campaign_data(batch={"size": 4})
    make_campaign(tmp_path / "run", data)
    found = export_autodrive(tmp_path / "run", tmp_path / "logs")
    assert not found.notes
    assert len(found.files) == 9
    config = json.loads((tmp_path / "logs" / "config.json").read_text())
    instance = config["simulation_instances"][1]
    assert [instance[key] for key in ("time_of_day", "weather_id", "model")] == [780, 1, "yolov3"]
    log = (tmp_path / "logs" / "batch_1" / "aeb_metrics_sim_inst_2.csv").read_bytes()
    assert instance["exported"]["log_sha256"] == hashlib.sha256(log).hexdigest()
    import_autodrive(tmp_path / "logs", tmp_path / "back")
    before, after = held(tmp_path / "run"), held(tmp_path / "back")
    assert {case["verdict"] for case in before["cases"]} == {"pass", "collision"}
    assert after == before
    first, second = (
        [path.read_bytes() for path in sorted((tmp_path / name).rglob("*.csv"))]
        for name in ("logs", "again")
        if name == "logs" or export_autodrive(tmp_path / "back", tmp_path / "again")
    )
    # A second time round nothing is left to lose; the last rows' commands are missing both times.
    assert second == first


def test_logs_come_back_to_the_last_bit(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs")
    import_autodrive(tmp_path / "logs", tmp_path / "run")
    export_autodrive(tmp_path / "run", tmp_path / "out")
    found = import_autodrive(tmp_path / "out", tmp_path / "back")
    assert not found.left_out
    assert fingerprint(tmp_path / "back") == fingerprint(tmp_path / "run")


def boxes(*given: tuple[str, float, float, float]) -> list[dict[str, Any]]:
    return [
        dict(zip(DETECTION_FIELDS, (label, confidence, 1.0, 2.0, width, height), strict=True))
        for label, confidence, width, height in given
    ]


def test_the_box_is_the_one_that_the_script_looks_at(tmp_path: Path) -> None:
    def change(case, end):
        path = tmp_path / "run" / end.attempt_dir / "kpi.parquet"
        columns = read_kpi(path).to_pydict()
        columns["detections"][0] = boxes(("car", 0.9, 9.0, 9.0), ("bus", 0.75, 20.9, 10.9))
        columns["detections"][1] = boxes(("car", 0.9, 80.5, 40.0), ("bus", 0.49, 20.0, 10.0))
        columns["detections"][2] = boxes(("=cmd|' /C calc'!A0,\n<b>", 0.9, 1.0, 1.0))
        columns["steering_rad"][0] = -STEERING_MAX_RAD / 2
        table = kpi_table(columns)
        write_kpi(table, path)
        return replace(end, kpi_sha256=kpi_sha256(table))

    make_campaign(tmp_path / "run", change=change)
    export_autodrive(tmp_path / "run", tmp_path / "logs")
    path = tmp_path / "logs" / "batch_1" / "aeb_metrics_sim_inst_1.csv"
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert [(r["Label"], r["Confidence (%)"], r["Size (px^2)"]) for r in rows[:4]] == [
        ("bus", "75.0", "200"),
        ("car", "90.0", "3200"),
        ("'=cmd|' /C calc'!A0, <b>", "90.0", "1"),
        ("", "0.0", ""),
    ]
    assert float(rows[0]["Steering (%)"]) == pytest.approx(-0.5)
    assert (rows[-1]["AEB (bool)"], rows[-1]["Throttle (%)"]) == ("", "")
    import_autodrive(tmp_path / "logs", tmp_path / "back")
    attempt = tmp_path / "back" / "cases" / "yolov3-0500-clear" / "attempt-1" / "kpi.parquet"
    assert read_kpi(attempt).to_pylist()[2]["detections"][0]["label"] == "=cmd|' /C calc'!A0, <b>"


def test_what_the_layout_does_not_hold_is_said(tmp_path: Path) -> None:
    data = campaign_data(
        matrix={"model": ["yolov3"], "weather": ["clear"], "scenario.ego_start_m": [40, 60]}
    )

    def change(case, end):
        lost = case.variation.scenario.ego_start_m == 60
        return replace(end, outcome="unresolved", kpi_sha256="", verdict="") if lost else end

    make_campaign(tmp_path / "run", data, change)
    found = export_autodrive(tmp_path / "run", tmp_path / "logs")
    assert len(found.files) == 2
    repeats, missing = found.notes
    assert "no column for scenario.ego_start_m" in repeats
    assert missing == "case yolov3-clear-ego_start_m_60: unresolved, no log"
    import_autodrive(tmp_path / "logs", tmp_path / "back")
    statuses = [case["status"] for case in report_json(tmp_path / "back")["cases"]]
    assert statuses == ["pass", "unresolved"]


def test_what_does_not_fit_is_one_line_and_nothing_is_written(tmp_path: Path) -> None:
    lane = campaign_data(scenario={"type": "lane_keeping", "duration_s": 2})
    make_campaign(tmp_path / "lane", lane)
    own = campaign_data(
        environment={"custom": {"drizzle": {"rain": 0.2}}},
        matrix={"model": ["yolov3"], "weather": ["drizzle"]},
    )
    make_campaign(tmp_path / "own", own)
    for name, said in (("lane", "follows its lane"), ("own", "'drizzle' has no id")):
        with pytest.raises(UsageError, match=said) as caught:
            export_autodrive(tmp_path / name, tmp_path / "out")
        assert "\n" not in str(caught.value)
        assert not (tmp_path / "out").exists()
    make_campaign(tmp_path / "run")
    with pytest.raises(UsageError, match="not an empty folder"):
        export_autodrive(tmp_path / "run", tmp_path / "run")
    kpi = next((tmp_path / "run").rglob("kpi.parquet"))
    kpi.write_bytes(kpi.read_bytes()[:-9])
    with pytest.raises(InfrastructureError, match=r"kpi\.parquet"):
        export_autodrive(tmp_path / "run", tmp_path / "out")
