"""What reports say of imported logs, and what they do not: nothing was run and nothing measured."""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

import msgspec
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner
from unit.conductor.report.autodrive_logs import MODELS, Rows, config, drive, write_logs
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign, rested

from conductor.cli import app
from conductor.report import make_report, report_json, write_result_page
from conductor.report.autodrive.export import export_autodrive
from conductor.report.autodrive.importing import import_autodrive
from conductor.report.compare.folders import compare_folders
from conductor.report.compare.page import as_html, as_json, as_markdown
from conductor.report.reading.dossier import open_dossier
from twin.base.errors import UsageError

NEVER = (
    *("real-time", "Real-time", "Workers", "run it again", "not recorded", "Speed-up", "Leases"),
    *("Slowest", "Attempts", "Resources", "Device class", "device class", "Seed", "seed"),
    *("Software digest", "software digest", "Sim time", "sim time", "Impact", "TTC", "attempts"),
)
"""What no report of logs speaks of, because logs do not hold it."""


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Imported logs: passes, collisions, far stops and one that is not decided."""

    def rows(instance: dict[str, Any]) -> Rows:
        if instance["model"] == "yolov3-tiny" and instance["weather_id"] == 4:
            return drive(instance, brake_m=2.0, stop_m=0.0)
        if instance == config()["simulation_instances"][0]:
            return drive(instance)[:125]
        return drive(
            instance, brake_m=70.0, stop_m=65.0 if instance["time_of_day"] == 300 else 20.0
        )

    write_logs(tmp_path / "logs", rows=rows)
    import_autodrive(tmp_path / "logs", tmp_path / "run")
    return tmp_path / "run"


def words_of(page: str) -> str:
    """What a reader of a page sees, without its scripts, styles and Plotly."""
    page = re.sub(r"<(script|style|select)\b.*?</\1>", " ", page, flags=re.DOTALL)
    return html.unescape(re.sub(r"<[^>]+>", " ", page))


def test_the_page_speaks_of_nothing_that_was_not_measured(run: Path) -> None:
    page = make_report(run, plots=False).page.read_text()
    words = words_of(page)
    assert [word for word in NEVER if word in words] == []
    assert "Time in the log [s]" in words
    assert 'title": "Sim time' not in page
    assert "To import the logs again" in words


def test_the_result_page_speaks_of_nothing_that_was_not_measured(run: Path, tmp_path: Path) -> None:
    text = write_result_page(run, tmp_path / "page.md").read_text()
    assert [word for word in NEVER if word in text] == []


def test_json_and_summary_have_null_where_nothing_was_measured(run: Path) -> None:
    tables = report_json(run)
    absent = ("seed", "software", "device_classes", "resources", "speed")
    assert {tables[name] for name in absent} == {None}
    absent = ("attempts", "wall_s", "worker", "device_class", "impact_speed_mps", "speed_max_mps")
    assert {case[name] for case in tables["cases"] for name in absent} == {None}
    make_report(run, plots=False)
    columns = pq.read_table(run / "summary.parquet").to_pydict()
    for name in ("attempts", "wall_s", "worker", "device_class"):
        assert set(columns[name]) == {None}


def test_a_comparison_speaks_of_no_software_and_no_device(run: Path, tmp_path: Path) -> None:
    import_autodrive(tmp_path / "logs", tmp_path / "again")
    found = compare_folders(run, tmp_path / "again")
    for text in (as_markdown(found), words_of(as_html(found))):
        assert "software" not in text
        assert "device" not in text
    sides = [as_json(found)[name] for name in ("before", "after")]
    assert [(side["software"], side["device_classes"]) for side in sides] == [(None, None)] * 2


def test_there_is_no_speed_up_of_logs(run: Path) -> None:
    with pytest.raises(UsageError, match="logs do not say how long"):
        make_report(run, serial=run, plots=False)


def test_the_terminal_tells_first_what_the_rule_of_the_study_hides(tmp_path: Path) -> None:
    far = lambda instance: drive(instance, brake_m=70.0, stop_m=65.0)  # noqa: E731
    write_logs(tmp_path / "logs", config(MODELS[:1]), far)
    out = tmp_path / "run"
    arguments = ["report", "--import-autodrive", str(tmp_path / "logs"), "--out", str(out)]
    done = CliRunner().invoke(app, arguments)
    assert (
        "conductor: 0 of 4 cases passed, 4 false braking (stopped further than 30 m from the "
        "obstacle). Without a collision, the rule of the AutoDRIVE study: 4 of 4.\n" in done.stderr
    )


def test_at_rest_is_the_distance_at_the_rest_that_the_verdict_is_about(tmp_path: Path) -> None:
    def rows(instance: dict[str, Any]) -> Rows:
        far, near = drive(instance, brake_m=99.0, stop_m=90.0), drive(instance)
        stamps = [f"2024-03-18 16:{35 + s // 60}:{s % 60:02}.250000" for s in range(300)]
        return [
            {**row, "Timestamp": at}
            for row, at in zip([*far[:80], *near[59:]], stamps, strict=False)
        ]

    write_logs(tmp_path / "logs", config(MODELS[:1]), rows)
    import_autodrive(tmp_path / "logs", tmp_path / "run")
    shows_the_rest(tmp_path / "run", rest_m=90.0, end_m=20.0)


def test_at_rest_is_the_distance_at_rest_in_our_own_runs(tmp_path: Path) -> None:
    def drove_on(_: Any, end: Any) -> Any:
        return rested(tmp_path / "run", end, 44.75)

    data = campaign_data(matrix={"model": ["yolov3"], "weather": ["clear"]})
    make_campaign(tmp_path / "run", data, drove_on)
    end_m = report_json(tmp_path / "run")["cases"][0]["dtc_end_m"]
    assert end_m < 30.0
    shows_the_rest(tmp_path / "run", rest_m=44.75, end_m=end_m)


def shows_the_rest(run: Path, *, rest_m: float, end_m: float) -> None:
    """The table of false braking has the distance of the reason, and it is in the JSON output."""
    case = report_json(run)["cases"][0]
    assert (case["false_braking_dtc_m"], case["dtc_end_m"]) == (rest_m, end_m)
    assert case["reasons"][0].startswith(f"came to rest {rest_m:.2f} m from the obstacle")
    page = make_report(run, plots=False).page.read_text()
    table = page[page.index('id="false-braking"') :]
    rows = re.search(r"<tbody>(.*?)</tbody>", table, re.DOTALL)
    assert rows is not None
    cells = re.findall(r'<td class="n">([^<]*)</td>', rows[1])
    assert cells[2] == f"{rest_m:.2f}"
    # A second report reads it from what the first one kept.
    assert report_json(run)["cases"][0]["false_braking_dtc_m"] == rest_m


def test_an_export_comes_back_without_a_warning_and_with_the_same_verdicts(tmp_path: Path) -> None:
    """Whatever a verdict is made of: what a log does not hold travels beside it."""
    ends = iter(
        [
            {"verdict": "time_up", "reasons": ["time is up at 3.00 m/s"]},
            {"verdict": "false_braking", "reasons": ["came to rest 44.00 m from the obstacle"]},
            {"outcome": "failed", "verdict": "a command is NaN", "reasons": ["a command is NaN"]},
            {"verdict": "pass", "reasons": ["went round the obstacle without touching it"]},
            {
                "outcome": "unresolved",
                "verdict": "",
                "reasons": ["three crashes"],
                "kpi_sha256": "",
                "attempt_dir": "",
                "attempt": 0,
            },
        ]
    )
    make_campaign(
        tmp_path / "run",
        campaign_data(campaign="night-watch"),
        lambda case, end: msgspec.structs.replace(end, **next(ends, {})),
    )
    export_autodrive(tmp_path / "run", tmp_path / "logs")
    out = tmp_path / "back"
    arguments = ["report", "--import-autodrive", str(tmp_path / "logs"), "--out", str(out)]
    done = CliRunner().invoke(app, arguments)
    before, after = open_dossier(tmp_path / "run"), open_dossier(out)
    assert after.imported is not None
    assert (after.imported.left_out, after.imported.warnings) == ([], [])
    assert after.campaign.campaign == "night-watch"

    def ended(dossier: Any) -> list[Any]:
        return [
            (r.case.id, r.status, r.end.verdict, r.passed, r.no_collision, r.end.reasons)
            for r in dossier.rows
        ]

    assert ended(after) == ended(before)
    assert len(done.stderr.splitlines()) == 1  # how the cases ended
    export_autodrive(out, tmp_path / "logs-2")
    import_autodrive(tmp_path / "logs-2", tmp_path / "back-2")
    assert ended(open_dossier(tmp_path / "back-2")) == ended(before)


def test_an_exported_log_that_was_changed_is_judged_by_what_it_holds(tmp_path: Path) -> None:
    make_campaign(tmp_path / "run", campaign_data(matrix={"model": ["yolov3"]}))
    export_autodrive(tmp_path / "run", tmp_path / "logs")
    log = tmp_path / "logs" / "batch_1" / "aeb_metrics_sim_inst_1.csv"
    log.write_text("".join(log.read_text().splitlines(keepends=True)[:60]))
    import_autodrive(tmp_path / "logs", tmp_path / "back")
    (row,) = open_dossier(tmp_path / "back").rows
    assert (row.status, row.no_collision) == ("unresolved", None)
