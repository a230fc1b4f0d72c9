"""``conductor report`` says by its exit code what the page says in its headline."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner
from unit.conductor.report.autodrive_logs import write_logs
from unit.conductor.report.synthetic_campaign import make_campaign

from conductor.cli import app
from conductor.records.outcomes import encode_outcomes, read_outcomes
from conductor.report.autodrive.importing import import_autodrive
from conductor.report.reading.dossier import open_dossier

replace = msgspec.structs.replace


def _report(folder: Path, *options: str) -> int:
    return CliRunner().invoke(app, ["report", str(folder), *options]).exit_code


@pytest.mark.parametrize(
    ("last", "code"),
    [
        ({"verdict": "pass"}, 0),
        ({"verdict": "collision"}, 1),
        ({"verdict": "false_braking"}, 1),
        ({"verdict": "time_up"}, 1),
        ({"outcome": "failed", "verdict": ""}, 1),
        ({"outcome": "unresolved", "verdict": "", "kpi_sha256": "", "attempt": 0}, 3),
        ({"outcome": "", "verdict": "", "kpi_sha256": "", "attempt": 0}, 75),
    ],
)
def test_one_case_of_eight_decides(tmp_path: Path, last: dict[str, str], code: int) -> None:
    def change(case, end):
        mine = last if case.id == "yolov3-0500-clear" else {"verdict": "pass"}
        return replace(end, **mine)

    make_campaign(tmp_path, change=change)
    dossier = open_dossier(tmp_path)
    assert (dossier.exit_code, dossier.passed) == (code, 8 if code == 0 else 7)


def test_outcomes_of_an_earlier_version_that_call_false_braking_passed(tmp_path: Path) -> None:
    make_campaign(tmp_path, change=lambda case, end: replace(end, verdict="false_braking"))
    path = tmp_path / "outcomes.json"
    text = encode_outcomes(read_outcomes(tmp_path)).decode()
    assert text.count('"passed": false') == 8
    path.write_text(text.replace('"passed": false', '"passed": true'))
    assert _report(tmp_path) == 1
    page = (tmp_path / "report.html").read_text()
    assert "<strong>0</strong> of 8 cases passed" in page
    assert "Without a collision, the rule of the AutoDRIVE paper: 8 of 8." in page


def test_imported_logs_that_decide_nothing_are_no_lost_infrastructure(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs")
    import_autodrive(tmp_path / "logs", tmp_path / "run")
    assert open_dossier(tmp_path / "run").exit_code == 0
    outcomes = read_outcomes(tmp_path / "run")
    undecided = {
        name: replace(end, outcome="unresolved", verdict="") for name, end in outcomes.cases.items()
    }
    path = tmp_path / "run" / "outcomes.json"
    path.write_bytes(encode_outcomes(replace(outcomes, cases=undecided)))
    assert open_dossier(tmp_path / "run").exit_code == 1
