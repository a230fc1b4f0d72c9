"""Results of a rulebook: counts and standings by hand, tables, the file and the page."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import msgspec
import pytest
from unit.conductor.report.synthetic_campaign import make_campaign

from conductor.records.outcomes import CaseOutcome
from conductor.report import make_report, report_json, write_result_page
from conductor.report.reading.dossier import open_dossier
from conductor.report.rulebook.figure import residual_figure
from conductor.report.rulebook.results import rulebook_result, standing_of
from conductor.report.rulebook.shown import rulebook_shown
from conductor.report.rulebook.side_by_side import paired_tables
from schemas.case import Case
from schemas.files.rulebook_result import RulebookCount, RulebookResult
from schemas.kinds.scenario import trial_of

LIMIT = {"rule": "limit", "impact_kmh": [[40, 0], [50, 25], [60, 35]]}
BOOK: dict[str, Any] = {
    "title": "Rules of the yard",
    "source": "the caretaker",
    "rank": "A",
    "groups": {
        "car": {
            "title": "Car to car",
            "clause": "5.2",
            "failures_max": 0.25,
            "table": {"x": "ego.speed_kmh"},
        },
        "plate": {"title": "Steel plate"},
    },
    "rows": [
        {
            "row": "standing",
            "test": "Standing car",
            "group": "car",
            "storyboard": "r152-car-stationary",
            "values": {"ego.speed_kmh": [40, 50, 60]},
            "varied": {"ego.speed_kmh": [-2, 0]},
            "repetitions": 2,
            "trial": LIMIT,
        },
        {
            "row": "plate",
            "test": "Plate",
            "group": "plate",
            "rank": "C",
            "note": "Its height is a guess.",
            "storyboard": "r152-car-stationary",
            "values": {"ego.speed_kmh": [80]},
            "trial": {"rule": "no_reaction"},
        },
    ],
}


def campaign(**changes: Any) -> dict[str, Any]:
    return {
        "campaign": "yard",
        "seed": 1,
        "scenario": {
            "type": "storyboard",
            "storyboard": "r152-car-stationary",
            "driver": "robot",
            "duration_s": 20,
        },
        "rulebook": {**BOOK, **changes},
    }


def speed_of(case: Case) -> float:
    trial = trial_of(case.variation.scenario)
    return float(trial.written.get("storyboard.ego.speed_kmh", trial.speed_kmh))


def ended(
    verdict: str, begin_kmh: float, impact_kmh: float | None, end: CaseOutcome
) -> CaseOutcome:
    scalars = {
        **end.scalars,
        "trial_speed_mps": begin_kmh / 3.6,
        "trial_closing_mps": begin_kmh / 3.6,
        "impact_relative_mps": None if impact_kmh is None else impact_kmh / 3.6,
        "speed_reduction_mps": None if impact_kmh is None else (begin_kmh - impact_kmh) / 3.6,
    }
    return msgspec.structs.replace(
        end, verdict=verdict, scalars=scalars, reasons=[f"{verdict} <b>by hand</b>"]
    )


def result_of(folder: Path, ends: dict[str, str], **changes: Any) -> RulebookResult:
    """The result of runs that pass but for those in ``ends``, by parts of their case's id."""

    def change(case: Case, end: CaseOutcome) -> CaseOutcome:
        told = [verdict for part, verdict in ends.items() if part in case.id]
        verdict = told[0] if told else "pass"
        if verdict == "lost":
            return msgspec.structs.replace(end, outcome="unresolved", verdict="")
        impact_kmh = 30.0 if verdict == "fail" else None
        return ended(verdict, speed_of(case), impact_kmh, end)

    make_campaign(folder, campaign(**changes), change)
    result = rulebook_result(open_dossier(folder))
    assert result is not None
    return result


def test_rows_points_and_runs_are_those_of_the_rulebook(tmp_path: Path) -> None:
    result = result_of(tmp_path, {})
    assert [(row.row, len(row.points)) for row in result.rows] == [("standing", 3), ("plate", 1)]
    standing = result.rows[0]
    assert [p.values["storyboard.ego.speed_kmh"] for p in standing.points] == [40, 50, 60]
    assert [p.limit_kmh for p in standing.points] == [0.0, 25.0, 35.0]
    for point in standing.points:
        assert [run.repetition for run in point.runs] == [0, 1]
        assert point.runs[0].drawn == {}
        (drawn,) = point.runs[1].drawn.values()
        written = point.values["storyboard.ego.speed_kmh"]
        assert isinstance(written, float)
        assert written - 2 <= drawn <= written
    assert [row.rank for row in result.rows] == ["A", "C"]
    assert result.rows[1].points[0].limit_kmh is None
    assert (result.standing, result.count.passed, result.count.runs) == ("passed", 7, 7)
    assert not result.partial


def test_a_share_of_the_runs_may_fail(tmp_path: Path) -> None:
    result = result_of(tmp_path, {"_50-r1": "fail"})
    assert result.rows[0].standing == "failed", "a row has no share"
    car = result.groups[0]
    assert (car.count.passed, car.count.failed, car.count.share) == (5, 1, pytest.approx(1 / 6))
    assert (car.standing, result.standing) == ("passed", "passed")


def test_more_than_the_share_fails_and_so_does_the_rulebook(tmp_path: Path) -> None:
    result = result_of(tmp_path, {"_50": "fail"})
    assert [group.standing for group in result.groups] == ["failed", "passed"]
    assert result.standing == "failed"
    (run, _) = result.rows[0].points[1].runs
    assert run.impact_kmh == pytest.approx(30.0)
    assert run.reduced_kmh == pytest.approx(20.0)


@pytest.mark.parametrize("verdict", ["inconclusive", "lost"])
def test_what_is_not_conclusive_leaves_it_open(tmp_path: Path, verdict: str) -> None:
    result = result_of(tmp_path, {"plate": verdict})
    assert [group.standing for group in result.groups] == ["passed", "open"]
    assert result.standing == "open"
    count = result.groups[1].count
    assert (count.inconclusive, count.missing) == (int(verdict != "lost"), int(verdict == "lost"))
    assert count.share is None
    assert result.rows[1].points[0].runs[0].passed is None


@pytest.mark.parametrize(
    ("passed", "failed", "inconclusive", "share", "standing"),
    [
        (9, 1, 0, 0.1, "passed"),
        (8, 2, 0, 0.1, "failed"),
        (8, 1, 1, 0.1, "open"),
        (0, 0, 0, 0.1, "open"),
        (3, 0, 1, 0.0, "open"),
        (0, 1, 9, 0.0, "failed"),
        (0, 1, 9, 0.1, "open"),
    ],
)
def test_standings_by_hand(
    passed: int, failed: int, inconclusive: int, share: float, standing: str
) -> None:
    runs = passed + failed + inconclusive
    count = RulebookCount(
        runs=runs, passed=passed, failed=failed, inconclusive=inconclusive, missing=0
    )
    assert standing_of(count, share) == standing


def test_tables_are_those_of_the_protocol(tmp_path: Path) -> None:
    result = result_of(tmp_path, {"_60-r1": "fail", "plate": "false_reaction"})
    shown = rulebook_shown(open_dossier(tmp_path), result)
    assert shown is not None
    car, plate = shown.tables
    assert car.columns == ("40", "50", "60")
    assert car.x_label == "Ego speed [km/h]"
    (line,) = car.lines
    assert line.label == "Standing car"
    assert [cell.text for cell in line.cells if cell] == ["2/2", "2/2", "30 · 1/2"]
    assert [cell.status for cell in line.cells if cell] == ["pass", "pass", "fail"]
    assert plate.lines[0].cells[0] is not None
    assert plate.lines[0].cells[0].status == "false_reaction"
    assert plate.notes == ("Its height is a guess.",)
    assert shown.second_hand == (
        "Figures of Plate are second-hand (rank C: somebody's reading of the source)."
    )
    assert [run.status for _, run in shown.lost] == ["fail", "false_reaction"]
    assert shown.varied == "Ego speed [km/h]"


def test_the_page_and_the_file_hold_it(tmp_path: Path) -> None:
    result = result_of(tmp_path, {"_60-r1": "fail"})
    make_report(tmp_path, plots=False)
    written = msgspec.json.decode((tmp_path / "rulebook.json").read_bytes(), type=RulebookResult)
    assert msgspec.structs.replace(written, fingerprint="") == result
    assert written.fingerprint
    page = (tmp_path / "report.html").read_text()
    assert "A simulation, and no type approval." in page
    assert "Rules of the yard: passed" in page
    assert "fail &lt;b&gt;by hand" in page
    assert "<b>by hand" not in re.sub(r"<script>.*?</script>", "", page, flags=re.S)
    assert report_json(tmp_path)["rulebook"]["standing"] == "passed"
    text = write_result_page(tmp_path, tmp_path / "result.md").read_text()
    assert "## Rules of the yard: passed" in text
    assert "| Standing car | ✓ 2/2 | ✓ 2/2 | ✗ 30 · 1/2 |" in text


@pytest.mark.parametrize("listed", [False, True])
def test_a_matrix_has_a_table_of_its_values(tmp_path: Path, listed: bool) -> None:
    """Also where some cases of it were chosen, which are listed then."""
    data = campaign() | {"matrix": {"weather": ["clear", "heavy_fog"]}}
    if listed:
        points = [
            {"row": "standing", "storyboard.ego.speed_kmh": speed, "weather": weather, "repeat": 0}
            for speed in (40, 60)
            for weather in ("clear", "heavy_fog")
        ]
        data |= {"matrix": {}, "cases": points}

    def change(case: Case, end: CaseOutcome) -> CaseOutcome:
        failed = case.variation.weather == "heavy_fog" and "_60" in case.id
        return ended("fail" if failed else "pass", speed_of(case), 30.0 if failed else None, end)

    make_campaign(tmp_path, data, change)
    dossier = open_dossier(tmp_path)
    shown = rulebook_shown(dossier, rulebook_result(dossier))
    assert shown is not None
    (table,) = shown.beyond
    assert table.label == "Weather"
    if listed:
        assert table.columns == ["Car to car"]
        assert table.lines == [("clear", ["2/2", "2/2"]), ("heavy fog", ["1/2", "1/2"])]
    else:
        assert table.columns == ["Car to car", "Steel plate"]
        assert table.lines == [
            ("clear", ["6/6", "1/1", "7/7"]),
            ("heavy fog", ["4/6", "1/1", "5/7"]),
        ]
    (cell,) = (
        c for t in shown.tables for line in t.lines for c in line.cells if c and "30" in c.text
    )
    assert cell.text == ("30 · 1/2" if listed else "30 · 2/4")


def test_residual_speeds_have_a_panel_per_group_and_a_point_per_run(tmp_path: Path) -> None:
    result = result_of(tmp_path, {"_60-r1": "fail"})
    figure = residual_figure(result)
    assert figure is not None
    titles = [note["text"] for note in figure["layout"]["annotations"]]
    assert titles == ["Car to car", "Steel plate"]
    car, plate = (t for t in figure["data"] if t["mode"] == "markers")
    assert (len(car["x"]), len(plate["x"])) == (6, 1)
    assert max(car["y"]) == 30.0
    assert car["xaxis"] != plate["xaxis"]
    (limits,) = (t for t in figure["data"] if t.get("line", {}).get("shape") == "vh")
    assert list(zip(limits["x"], limits["y"], strict=True)) == [(40, 0), (50, 25), (60, 35)]
    stacked = residual_figure(result, columns=1)
    assert stacked is not None
    assert stacked["layout"]["height"] > figure["layout"]["height"]
    assert [trace["xaxis"] for trace in stacked["data"]] == [t["xaxis"] for t in figure["data"]]


def test_runs_that_ended_before_their_test_began_are_in_no_figure(tmp_path: Path) -> None:
    def acted_at_once(case: Case, end: CaseOutcome) -> CaseOutcome:
        done = ended("pass", speed_of(case), None, end)
        return msgspec.structs.replace(done, scalars={**done.scalars, "trial_speed_mps": None})

    make_campaign(tmp_path, campaign(), acted_at_once)
    result = rulebook_result(open_dossier(tmp_path))
    assert result is not None
    assert residual_figure(result) is None
    page = make_report(tmp_path, plots=False).page.read_text()
    assert "None: no test began" in page
    assert 'id="residual"' not in page


def test_a_campaign_without_a_rulebook_has_neither(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    make_report(tmp_path, plots=False)
    assert not (tmp_path / "rulebook.json").exists()
    assert "type approval" not in (tmp_path / "report.html").read_text()


def test_two_stacks_stand_side_by_side(tmp_path: Path) -> None:
    result_of(tmp_path / "before", {"_60-r1": "fail"})
    result_of(tmp_path / "after", {"plate": "false_reaction"})
    before, after = (open_dossier(tmp_path / side) for side in ("before", "after"))
    car, plate = paired_tables(before, after)
    assert car.columns == ["Test", "40", "50", "60"]
    assert car.lines == [["Standing car", "✓ 2/2", "✓ 2/2", "✗ 30 · 1/2 → ✓ 2/2"]]
    assert car.about.startswith("passed before, passed after.")
    assert plate.lines == [["Plate", "✓ → ↯"]]
    assert plate.about.startswith("passed before, failed after.")
    make_campaign(tmp_path / "other")
    assert paired_tables(before, open_dossier(tmp_path / "other")) == []
