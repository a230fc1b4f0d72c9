"""``summary.parquet`` and ``summary.csv``: one row per case, and missing stays missing."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import msgspec
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign

from conductor.report import write_summary
from schemas.files.kpi import SCALARS
from schemas.plan import expand
from twin.base.errors import InfrastructureError, UsageError

replace = msgspec.structs.replace


def test_one_row_per_case_in_campaign_order(tmp_path: Path) -> None:
    campaign, outcomes = make_campaign(tmp_path)
    table = write_summary(tmp_path)
    cases = expand(campaign)
    assert table.column("case").to_pylist() == [case.id for case in cases]
    assert table.column("time_of_day").to_pylist()[:2] == ["05:00", "13:00"]
    assert set(table.column("perception").to_pylist()) == {"ground_truth"}
    for column in SCALARS:
        expected = [outcomes.cases[case.id].scalars[column.name] for case in cases]
        assert table.column(column.name).to_pylist() == expected
    assert pq.read_table(tmp_path / "summary.parquet").equals(table)
    text = pa_csv.read_csv(tmp_path / "summary.csv")
    assert text.num_rows == len(cases)
    assert not list(tmp_path.glob(".*.tmp"))


def test_missing_is_null_and_never_a_pass(tmp_path: Path) -> None:
    def change(case, end):
        if case.variation.weather != "clear":
            return end
        # `passed` is set on purpose: only a verdict may pass.
        outcome = "unresolved" if case.variation.model == "yolov3" else ""
        return replace(end, outcome=outcome, verdict="", scalars={}, attempt=0, kpi_sha256="")

    make_campaign(tmp_path, change=change)
    rows = {row["case"]: row for row in write_summary(tmp_path).to_pylist()}
    for name in ("yolov3-0500-clear", "yolov2-tiny-0500-clear"):
        row = rows[name]
        assert row["passed"] is None
        assert row["verdict"] is None
        assert row["kpi_sha256"] is None
        assert row["wall_s"] is None
        assert all(row[column.name] is None for column in SCALARS)
    assert rows["yolov3-0500-clear"]["outcome"] == "unresolved"
    assert rows["yolov2-tiny-0500-clear"]["outcome"] is None
    passes = rows["yolov3-1300-heavy_fog"]
    assert passes["passed"] is not None
    assert passes["impact_speed_mps"] is None or not passes["passed"]


def test_a_failed_case_did_not_pass(tmp_path: Path) -> None:
    make_campaign(tmp_path, change=lambda case, end: replace(end, outcome="failed", verdict="NaN"))
    assert write_summary(tmp_path).column("passed").null_count == 8


def test_further_axes_are_columns_with_their_own_type(tmp_path: Path) -> None:
    data = campaign_data(
        matrix={
            "model": ["yolov3"],
            "scenario.ego_start_m": [40, 60],
            "camera.noise": [True, False],
        }
    )
    make_campaign(tmp_path, data)
    table = write_summary(tmp_path)
    assert table.column("scenario.ego_start_m").to_pylist() == [40.0, 40.0, 60.0, 60.0]
    assert table.column("camera.noise").to_pylist() == [True, False, True, False]


def test_noop_is_refused_in_one_line(tmp_path: Path) -> None:
    make_campaign(tmp_path, campaign_data(simulator="noop"))
    with pytest.raises(UsageError, match="noop") as caught:
        write_summary(tmp_path)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "summary.parquet").exists()


def test_campaign_and_outcomes_must_list_the_same_cases(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    path = tmp_path / "campaign.yaml"
    path.write_text(path.read_text().replace("heavy_fog", "heavy_rain"))
    with pytest.raises(InfrastructureError, match="different cases"):
        write_summary(tmp_path)


@pytest.mark.parametrize("content", [None, "campaign: [", "campaign: x\n"])
def test_a_damaged_campaign_file_is_one_line(tmp_path: Path, content: str | None) -> None:
    make_campaign(tmp_path)
    path = tmp_path / "campaign.yaml"
    path.unlink()
    if content is not None:
        path.write_text(content)
    with pytest.raises(InfrastructureError, match=r"campaign\.yaml") as caught:
        write_summary(tmp_path)
    assert "\n" not in str(caught.value)


def test_no_cell_of_the_csv_is_a_formula(tmp_path: Path) -> None:
    evil = ["=1+1", "+cmd|' /C calc'!A0", "-2+3", '@SUM(A1)"x', "\t=1", "fine"]

    def change(case, end):
        text = evil[case.variation.time_of_day_min % len(evil)]
        return replace(end, reasons=[text], worker=text, device_class=text)

    times = [f"05:0{n}" for n in range(6)]
    make_campaign(
        tmp_path, campaign_data(matrix={"model": ["yolov3"], "time_of_day": times}), change
    )
    table = write_summary(tmp_path)
    assert sorted(set(table.column("worker").to_pylist())) == sorted(evil), "only the CSV changes"
    with (tmp_path / "summary.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["worker"] for row in rows} == {"fine", *(f"'{text}" for text in evil[:-1])}
    for row in rows:
        for name, cell in row.items():
            assert not name.startswith(("=", "+", "-", "@"))
            number = re.fullmatch(r"-?[0-9.e+-]+", cell)
            assert number or not cell.startswith(("=", "+", "-", "@", "\t", "\r"))
