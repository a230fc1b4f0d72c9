"""Free driving in numbers: of one campaign, and of a series of parts."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner
from unit.conductor.report.synthetic_campaign import make_campaign

from conductor.cli import app
from conductor.records.outcomes import CaseOutcome
from conductor.report.driving.page import page
from conductor.report.driving.series import read_series, road_class, sums
from schemas.case import Case
from schemas.files.yaml_file import dump_yaml
from twin.base.errors import UsageError

COMMIT = "c" * 40


def data(*, weathers: tuple[str, ...] = ("clear", "heavy_fog")) -> dict[str, object]:
    names = ("driving-motorway", "driving-street")
    return {
        "schema": 1,
        "campaign": "free-driving-01",
        "seed": 5,
        "scenario": {
            "type": "storyboard",
            "storyboard": names[0],
            "driver": "robot",
            "robot_brake": 0.95,
            "free_driving": {},
        },
        "autonomy": {"perception": {"truth": {"type": "ground_truth"}}},
        "cases": [
            {"scenario.storyboard": name, "weather": weather, "time_of_day": hour}
            for name in names
            for weather in weathers
            for hour in ("13:00", "23:00")
        ],
    }


def driven(case: Case, end: CaseOutcome) -> CaseOutcome:
    """500 km each on motorways and 100 km on streets, one false braking in fog by night."""
    fast = "motorway" in case.id
    way_m = 125e3 if fast else 25e3
    false = not fast and "heavy_fog" in case.id and "2300" in case.id
    scalars = {
        "driven_m": way_m,
        "driven_fast_m": way_m if fast else 0.0,
        "partial_brakings": 2,
        "full_braking_s": 4.0 if false else None,
        "false_brakings": int(false),
    }
    verdict = "false_reaction" if false else "pass"
    reasons = ["the stack braked | fully"] if false else ["no full braking"]
    return msgspec.structs.replace(end, verdict=verdict, reasons=reasons, scalars=scalars)


def undecided(case: Case, end: CaseOutcome) -> CaseOutcome:
    if "1300-clear" in case.id:
        nothing = {"outcome": "unresolved", "verdict": "", "scalars": {}, "kpi_sha256": ""}
        return msgspec.structs.replace(end, **nothing)
    return driven(case, end)


def waiting(case: Case, end: CaseOutcome) -> CaseOutcome:
    if "1300-clear" in case.id:
        nothing = {"outcome": "", "verdict": "", "scalars": {}, "kpi_sha256": "", "attempt": 0}
        return msgspec.structs.replace(end, **nothing)
    return driven(case, end)


def part(folder: Path, number: int, change=driven) -> None:
    line = json.dumps({"part": number, "commit": COMMIT, "seed": 5})
    target = folder / f"part-{number:02}"
    target.mkdir(parents=True)
    (target / "campaign.yaml").write_text(dump_yaml(data()))
    with (folder / "parts.jsonl").open("a") as ledger:
        ledger.write(f"{line}\n")
    if change is not None:
        make_campaign(target / "run", data(), change)


def test_one_campaign_is_a_series_of_its_own(tmp_path):
    make_campaign(tmp_path / "run", data(), driven)
    series = read_series(tmp_path / "run")
    total = sums(series.cases)
    assert (total.cases, total.driven_m, total.false, total.full) == (8, 600e3, 1, 1)
    assert total.fast_share == pytest.approx(500 / 600)
    assert series.by(lambda case: case.road_class)["street"].driven_m == 100e3
    assert series.by(lambda case: str(case.night))["True"].false == 1
    # One event on 600 km: 0.0253 and 5.572 of it (Garwood), over 0.6.
    assert total.interval() == pytest.approx((0.02532 / 0.6, 5.57164 / 0.6), rel=1e-3)


def test_the_page_says_rate_interval_shares_and_every_braking(tmp_path):
    part(tmp_path, 2)
    part(tmp_path, 1)
    series = read_series(tmp_path)
    text = page(series, tmp_path)
    assert "**2 false full brakings on 1,200.0 km**: 1.67 per 1,000 km" in text
    assert "That is missed." in text
    assert "83.3 % of the distance was driven faster than 50 km/h" in text
    assert "| street | 8 | 200.0 | 16.7 % | 0.0 % | 16 | 0 | 2 |" in text
    assert text.count("false reaction | the stack braked \\| fully |") == 2
    assert text.index("| part-02 | `cccccccccccc`") < text.index("| part-01 | `cccccccccccc`")


def test_parts_that_were_made_count_before_they_run(tmp_path):
    part(tmp_path, 1)
    part(tmp_path, 2, None)
    text = page(read_series(tmp_path), tmp_path)
    assert "| part-02 | `cccccccccccc` | 5 |  | 0.0 | 0 | 0 | not begun |" in text
    assert "Kept so far; 400 km are left." in text


def test_parts_of_other_software_are_said(tmp_path):
    part(tmp_path, 1)
    part(tmp_path, 2)
    assert "| 5 | `555555555555` | 600.0 |" in page(read_series(tmp_path), tmp_path)
    assert "different software" not in page(read_series(tmp_path), tmp_path)
    outcomes = tmp_path / "part-02" / "run" / "outcomes.json"
    outcomes.write_text(outcomes.read_text().replace("5" * 64, "6" * 64))
    assert "They ran with different software" in page(read_series(tmp_path), tmp_path)


def test_cases_left_out_of_a_run_are_still_to_be_driven(tmp_path):
    part(tmp_path, 1, None)
    make_campaign(tmp_path / "part-01" / "run", data(weathers=("clear",)), driven)
    series = read_series(tmp_path)
    assert (len(series.cases), series.left) == (4, 4)
    assert "| 4 cases left |" in page(series, tmp_path)
    (tmp_path / "part-01" / "campaign.yaml").write_text("cases: 3\n")
    with pytest.raises(UsageError, match="not as `twin driving` writes it"):
        read_series(tmp_path)


def test_a_part_that_nobody_listed_is_refused(tmp_path):
    part(tmp_path, 1)
    make_campaign(tmp_path / "part-02" / "run", data(), driven)
    with pytest.raises(UsageError, match=r"part-02 ran, and parts\.jsonl does not list it"):
        read_series(tmp_path)


def test_cases_without_a_verdict_show_nothing(tmp_path):
    part(tmp_path, 1, undecided)
    series = read_series(tmp_path)
    assert len(series.undecided) == 2
    assert "2 cases have no verdict, so nothing is shown yet." in page(series, tmp_path)
    assert "| none |" in page(series, tmp_path)


@pytest.mark.parametrize(
    ("changes", "code"),
    [((driven,), 0), ((driven, driven), 1), ((waiting,), 75), ((undecided,), 1)],
)
def test_the_command_says_it_and_its_exit_code_does(tmp_path, changes, code):
    for number, change in enumerate(changes, start=1):
        part(tmp_path, number, change)
    out = tmp_path / "new" / "page.md"
    done = CliRunner().invoke(app, ["driving", str(tmp_path), "--markdown", str(out)])
    assert done.exit_code == code, done.output
    said = "1 false full braking:" if len(changes) == 1 else "2 false full brakings:"
    assert said in done.output
    assert out.read_text().startswith("# Free driving: results\n")
    told = CliRunner().invoke(app, ["driving", str(tmp_path), "--output", "json"])
    assert json.loads(told.output)["false"] == len(changes)


@pytest.mark.parametrize("line", ["{}", "no json", '{"part": 1}'])
def test_a_list_that_is_none_is_said(tmp_path, line):
    (tmp_path / "parts.jsonl").write_text(f"{line}\n")
    with pytest.raises(UsageError, match=r"parts\.jsonl:1: not a line"):
        read_series(tmp_path)


def test_a_folder_without_either_is_said(tmp_path):
    with pytest.raises(UsageError, match="neither a campaign folder nor a series"):
        read_series(tmp_path)


def test_another_campaign_is_no_free_driving(tmp_path):
    make_campaign(tmp_path / "run")
    with pytest.raises(UsageError, match="is no free driving"):
        read_series(tmp_path / "run")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("motorway-07.yaml", "motorway"),
        ("runs/driving/part-01/rural-31.yaml", "rural"),
        ("driving-street", "street"),
    ],
)
def test_classes_stand_in_the_names_of_scenarios(name, expected):
    assert road_class(name) == expected
