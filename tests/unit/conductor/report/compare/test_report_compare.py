"""Compare: planted regressions are found, re-runs are identical, and what cannot be compared."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Any

import msgspec
import pytest
from case_changes import changed
from typer.testing import CliRunner
from unit.conductor.report.synthetic_campaign import campaign_data, drive, make_campaign

from conductor.cli import app
from conductor.records.outcomes import encode_outcomes, read_outcomes
from conductor.report.compare.folders import compare_folders
from conductor.report.compare.page import as_html, as_json, as_markdown, told
from schemas.kinds.scenario import levels_of_verdicts, verdict_kinds
from schemas.names import WEATHERS
from schemas.plan import expand, parse_campaign
from schemas.sections.perception import GroundTruthPerception
from twin.base.errors import EXIT_FAILED, EXIT_PASS, InfrastructureError, UnfinishedError
from twin.base.errors import UsageError as Usage

replace = msgspec.structs.replace
HOURS = ["05:00", "07:00", "09:00", "11:00", "13:00", "15:00", "17:00", "19:00"]
MODELS = ["yolov2", "yolov2-tiny", "yolov3", "yolov3-tiny"]
HOSTILE = "<script>alert(1)</script> | `x` [a](b)\x1b[2J"


def paper_matrix() -> dict[str, Any]:
    """The 256 cases of the study."""
    return campaign_data(
        scenario={"ego_start_m": 40, "duration_s": 10, "standstill_s": 0},
        autonomy={"perception": {name: {"type": "ground_truth"} for name in MODELS}},
        matrix={"model": MODELS, "weather": list(WEATHERS), "time_of_day": HOURS},
    )


@pytest.fixture(scope="module")
def paper_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder: Path = tmp_path_factory.mktemp("paper") / "v1"
    make_campaign(folder, paper_matrix())
    return folder


def plant(run: Path, copy: Path, cases: list[str], *, reason: str = "") -> None:
    """A copy of ``run`` in which ``cases`` are driven by a stack that hardly sees."""
    shutil.copytree(run, copy)
    campaign, _ = parse_campaign(paper_matrix())
    assert campaign is not None
    outcomes = read_outcomes(copy)
    ends = dict(outcomes.cases)
    for case in expand(campaign):
        if case.id in cases:
            blind = GroundTruthPerception(contrast_min=1.0)
            end = drive(copy, changed(case, weather="heavy_fog", perception=blind))
            ends[case.id] = replace(end, reasons=[reason]) if reason else end
    told = replace(outcomes, cases=ends, software="6" * 64)
    (copy / "outcomes.json").write_bytes(encode_outcomes(told))


@pytest.mark.slow
def test_four_planted_flips_of_256_are_found(paper_run: Path, tmp_path: Path) -> None:
    outcomes = read_outcomes(paper_run)
    passing = [name for name, end in outcomes.cases.items() if end.passed]
    assert len(outcomes.cases) == 256
    planted = [name for name in passing if name.startswith("yolov3-0")][:4]
    plant(paper_run, tmp_path / "v2", planted, reason=HOSTILE)
    found = compare_folders(paper_run, tmp_path / "v2")
    assert [flip.case for flip in found.regressions] == planted
    assert {(flip.before, flip.after) for flip in found.flips} == {("pass", "collision")}
    assert (found.pairs, found.lost, found.won) == (256, 4, 0)
    assert (found.same_bytes, found.identical) == (252, False)
    assert found.p_value == pytest.approx(2 / 2**4)
    assert found.difference.estimate == pytest.approx(-4 / 256)
    # Four of 256 may be chance; that they are worse is a fact.
    assert found.difference.low < 0 < found.difference.high
    line = next(line for line in found.axes if line.value == "yolov3")
    assert line.passed_before - line.passed_after == 4
    shifts = {shift.name: shift for shift in found.shifts}
    closest, impact = shifts["dtc_min_m"], shifts["impact_speed_mps"]
    assert (closest.pairs, closest.changed) == (256, 4)
    assert closest.median is not None
    assert (closest.median.estimate, closest.median.low, closest.median.high) == (0, 0, 0)
    assert closest.mean is not None
    assert closest.mean.low < closest.mean.high < 0
    assert closest.largest_case in planted
    assert (closest.largest or 0) < 0
    assert (impact.lost, impact.gained) == (0, 4)

    runner = CliRunner()
    html, markdown = tmp_path / "out" / "c.html", tmp_path / "out" / "c.md"
    arguments = ["compare", str(paper_run), str(tmp_path / "v2")]
    files = ["--html", str(html), "--markdown", str(markdown)]
    done = runner.invoke(app, [*arguments, *files])
    assert done.exit_code == EXIT_FAILED
    assert "regression: 4 cases have become worse" in done.output
    assert all(name in done.output for name in planted)
    assert "\x1b" not in done.output
    assert "<script>" not in html.read_text()
    assert "&lt;script&gt;" in html.read_text()
    text = markdown.read_text()
    assert "<script>" not in text.replace("\\<", "")
    tables = [line for line in text.splitlines() if line.startswith("| yolov3")]
    assert {line.replace("\\|", "").count("|") for line in tables} == {6}
    done = runner.invoke(app, [*arguments, "--output", "json"])
    assert done.exit_code == EXIT_FAILED
    data = json.loads(done.stdout)
    assert data["result"] == "regression"
    assert [flip["case"] for flip in data["flips"]] == planted


def test_the_other_way_round_is_no_regression(paper_run: Path, tmp_path: Path) -> None:
    passing = [name for name, end in read_outcomes(paper_run).cases.items() if end.passed]
    plant(paper_run, tmp_path / "v0", passing[:30])
    arguments = ["compare", str(tmp_path / "v0"), str(paper_run), "--output", "json"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == EXIT_PASS
    data = json.loads(done.stdout)
    assert data["result"] == "no regression"
    assert data["says"][0] == "no regression: no case has become worse, 30 better"
    assert (data["lost"], data["won"]) == (0, 30)
    # Thirty flips are no chance, and they lie in one model.
    assert any(line["value"] == "yolov2" and line["p_value"] < 0.001 for line in data["axes"])
    assert any("Perception model yolov2" in line for line in data["says"])


def test_a_rerun_is_identical_and_a_single_bit_is_not(tmp_path: Path) -> None:
    make_campaign(tmp_path / "a")
    make_campaign(tmp_path / "b")
    done = CliRunner().invoke(app, ["compare", str(tmp_path / "a"), str(tmp_path / "b")])
    assert done.exit_code == EXIT_PASS
    assert done.output.startswith("identical (bytes): 8 cases, fingerprint ")
    outcomes = read_outcomes(tmp_path / "b")
    campaign, _ = parse_campaign(campaign_data())
    assert campaign is not None
    case = expand(campaign)[0]
    nudged = changed(
        case, scenario=replace(case.variation.scenario, ego_start_m=math.nextafter(60.0, 61))
    )
    end = drive(tmp_path / "b", nudged)
    ends = {**outcomes.cases, case.id: end}
    (tmp_path / "b" / "outcomes.json").write_bytes(encode_outcomes(replace(outcomes, cases=ends)))
    found = compare_folders(tmp_path / "a", tmp_path / "b")
    assert not found.identical
    assert found.same_bytes == 7
    assert not found.flips
    assert any("not deterministic" in note for note in found.notes)
    assert told(found).kind == "no regression"


def test_what_counts_as_worse(tmp_path: Path) -> None:
    after = {
        "yolov3-0500-clear": {"verdict": "false_braking"},
        "yolov3-1300-clear": {"outcome": "unresolved", "verdict": ""},
        "yolov2-tiny-0500-clear": {"outcome": "failed", "verdict": ""},
        "yolov3-0500-heavy_fog": {"verdict": "collision"},
    }
    before = {
        "yolov2-tiny-1300-clear": {"outcome": "cancelled", "verdict": ""},
        "yolov3-0500-heavy_fog": {"verdict": "time_up"},
    }

    def end_as(table):
        return lambda case, end: replace(end, **{"verdict": "pass", **table.get(case.id, {})})

    make_campaign(tmp_path / "a", change=end_as(before))
    make_campaign(tmp_path / "b", change=end_as(after))
    found = compare_folders(tmp_path / "a", tmp_path / "b")
    assert {flip.case for flip in found.regressions} == set(after)
    assert {flip.case: flip.change for flip in found.flips} == {
        **dict.fromkeys(after, "worse"),
        "yolov2-tiny-1300-clear": "better",
    }
    # Without a verdict is not passed; a missing KPI is in no mean.
    assert (found.passed_before, found.passed_after) == (6, 4)
    sides = (found.before, found.after)
    assert [(side.passed, side.no_collision) for side in sides] == [(6, 7), (4, 5)]


@pytest.mark.parametrize(
    ("before", "after", "change"),
    [
        ("avoided", "mitigated", "worse"),
        ("mitigated", "not_mitigated", "worse"),
        ("avoided", "not_mitigated", "worse"),
        ("pass", "fail", "worse"),
        ("pass", "false_reaction", "worse"),
        ("false_reaction", "fail", "worse"),
        ("avoided", "inconclusive", "worse"),
        ("mitigated", "inconclusive", "worse"),
        ("not_mitigated", "inconclusive", "other"),
        ("pass", "avoided", "other"),
        ("false_braking", "lane_departure", "other"),
        ("mitigated", "", "worse"),
        ("fail", "", "other"),
    ],
)
def test_trials_have_an_order_of_verdicts(
    tmp_path: Path, before: str, after: str, change: str
) -> None:
    """Also where both touched the target, or none did; the reverse is better."""

    def ends(verdict: str) -> dict[str, str]:
        return {"outcome": "verdict" if verdict else "unresolved", "verdict": verdict}

    for folder, verdict in (("a", before), ("b", after)):
        make_campaign(tmp_path / folder, change=lambda _, end, v=verdict: replace(end, **ends(v)))
    forth = compare_folders(tmp_path / "a", tmp_path / "b")
    back = compare_folders(tmp_path / "b", tmp_path / "a")
    assert {flip.change for flip in forth.flips} == {change}
    reverse = {"worse": "better", "other": "other"}[change]
    assert {flip.change for flip in back.flips} == {reverse}
    assert bool(forth.regressions) == (change == "worse")
    assert not back.regressions


def test_every_verdict_that_passes_is_better_than_any_other() -> None:
    levels = levels_of_verdicts()
    passing = {levels[kind.name] for kind in verdict_kinds() if kind.passes}
    others = {levels[kind.name] for kind in verdict_kinds() if not kind.passes}
    assert len(passing) == 1
    assert max(others) < min(passing)


def test_cases_of_one_run_are_listed_and_do_not_count(tmp_path: Path) -> None:
    make_campaign(tmp_path / "a")
    data = campaign_data()
    data["matrix"]["weather"] = ["clear", "heavy_snow"]
    data["seed"] = 8
    make_campaign(tmp_path / "b", data)
    found = compare_folders(tmp_path / "a", tmp_path / "b")
    assert found.pairs == 4
    assert {name.split("-")[-1] for name in found.only_before} == {"heavy_fog"}
    assert {name.split("-")[-1] for name in found.only_after} == {"heavy_snow"}
    assert not found.regressions
    assert "'seed' differs in 4 of 4 pairs" in found.notes[0]
    text = as_markdown(found)
    assert "4 cases only in the first run, not compared" in text
    assert "heavy\\_fog" in text
    data = as_json(found)
    assert json.loads(json.dumps(data, allow_nan=False))["shifts"][0]["median"]["low"] is None
    assert "too few for an interval" in as_html(found)


def test_runs_that_cannot_be_compared(tmp_path: Path) -> None:
    make_campaign(tmp_path / "a")
    data = campaign_data()
    data["matrix"]["weather"] = ["cloudy"]
    make_campaign(tmp_path / "other", data)
    lane = campaign_data(scenario={"type": "lane_keeping", "duration_s": 2})
    make_campaign(tmp_path / "lane", lane)
    make_campaign(tmp_path / "noop", campaign_data(simulator="noop"))
    (tmp_path / "empty").mkdir()
    for name, said in (
        ("other", "no case id in common"),
        ("lane", "is about lane_keeping|about jump_scare"),
        ("noop", "noop"),
        ("empty", "no outcomes.json"),
        ("absent", "no outcomes.json"),
    ):
        for one, two in (("a", name), (name, "a")):
            with pytest.raises(Usage, match=said) as caught:
                compare_folders(tmp_path / one, tmp_path / two)
            assert "\n" not in str(caught.value)


def test_unfinished_and_damaged_runs(tmp_path: Path) -> None:
    make_campaign(tmp_path / "a")

    def left(case, end):
        return replace(end, outcome="") if case.variation.weather == "clear" else end

    make_campaign(tmp_path / "b", change=left)
    with pytest.raises(UnfinishedError, match="4 of 8 cases have not ended"):
        compare_folders(tmp_path / "a", tmp_path / "b")
    next((tmp_path / "a").rglob("kpi.parquet")).unlink()
    with pytest.raises(InfrastructureError, match=r"kpi\.parquet"):
        compare_folders(tmp_path / "a", tmp_path / "a")


@pytest.mark.parametrize("option", ["--html", "--markdown"])
def test_files_of_another_kind_are_refused_before_anything_is_read(
    tmp_path: Path, option: str
) -> None:
    done = CliRunner().invoke(app, ["compare", "a", "b", option, str(tmp_path / "x.txt")])
    assert isinstance(done.exception, Usage)
    assert "ends in" in str(done.exception)
