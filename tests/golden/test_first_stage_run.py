"""A run folder of the first stage (0.1) is still read by everything that reads finished runs.

`first_stage_run/finished` is a whole run: three cases, one of them with its recording, signed; only
the page and its pictures are left out. `first_stage_run/unfinished` is what is left of a journal
when its run is stopped after two of the same cases. `first_stage_run/attempt` is an attempt of its
own, with the record of its drive and the journal of an intervention. None is ever made anew.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from conductor.cli import app as conductor_app
from devkit.cli import app as devkit_app
from twin.base.errors import UsageError
from twin.base.software import device_class
from twin.rig.interventions.journal import read_journal
from viewer.cli import app as viewer_app

HERE = Path(__file__).parent / "first_stage_run"
FINGERPRINT = "39f713e0e3242e2399876f44dcd324bcee7c8562bf76eec31d20e848b7ff6d1d"
RECORDED = "yolov2-tiny-0500-heavy_snow-latency_ms_100-duration_s_0.5-ego_speed_mps_14"
CASES = ["yolov3-1300-clear", "yolov2-tiny-0500-clear", RECORDED]


@pytest.fixture
def finished(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The finished run, where a command may write beside it; the key that signed it is trusted."""
    trusted = tmp_path / "home" / "trusted"
    trusted.mkdir(parents=True)
    shutil.copy(HERE / "key.pub", trusted)
    monkeypatch.setenv("DRIVETWIN_HOME", str(tmp_path / "home"))
    return Path(shutil.copytree(HERE / "finished", tmp_path / "finished"))


def conductor(*words: object) -> Result:
    """A command of the conductor, as it ends."""
    return CliRunner().invoke(conductor_app, [str(word) for word in words])


def test_its_fingerprint_is_what_it_was(finished: Path) -> None:
    told = conductor("fingerprint", finished)
    assert (told.exit_code, told.stdout.strip()) == (0, FINGERPRINT)


def test_it_is_as_it_was_signed(finished: Path) -> None:
    told = conductor("verify", finished, "--deep")
    assert told.exit_code == 0, told.output
    key = json.loads((finished / "manifest.json").read_text())["key"]
    assert f"signed by key {key}" in told.stdout


def test_it_is_reported(finished: Path) -> None:
    told = conductor("report", finished)
    assert told.exit_code == 1, told.output  # one case is no pass
    page = (finished / "report.html").read_text()
    assert all(case in page for case in CASES)
    before = (HERE / "finished" / "summary.csv").read_text()
    assert (finished / "summary.csv").read_text() == before


def test_it_is_compared_with_itself(finished: Path) -> None:
    told = conductor("compare", HERE / "finished", finished, "--output", "json")
    assert told.exit_code == 0, told.output
    assert json.loads(told.stdout)["result"] == "identical"


def test_it_is_exported(finished: Path, tmp_path: Path) -> None:
    told = conductor("export", finished, "--out", tmp_path / "exported")
    assert told.exit_code == 0, told.output
    assert len(list((tmp_path / "exported").rglob("*.csv"))) == len(CASES)


def test_what_has_not_ended_is_left_to_its_release(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(HERE / "unfinished", tmp_path / "unfinished"))
    told = conductor("run", folder / "campaign.yaml", "--out", folder, "--view", "none")
    assert isinstance(told.exception, UsageError), told.output
    (line,) = str(told.exception).splitlines()
    assert "begun by drivetwin 0.1" in line
    assert "finish it with that release" in line


def test_its_recording_is_shown(finished: Path, tmp_path: Path) -> None:
    out = tmp_path / "frame.png"
    words = ["frame", str(finished), RECORDED, "--at", "0.3", "--out", str(out)]
    shown = CliRunner().invoke(viewer_app, words)
    assert shown.exit_code == 0, shown.output
    assert out.read_bytes().startswith(b"\x89PNG")


def test_a_finished_one_is_not_run_again(finished: Path, tmp_path: Path) -> None:
    told = conductor("run", finished / "campaign.yaml", "--out", finished)
    assert isinstance(told.exception, UsageError)
    assert "drivetwin 0.1 has run and finished it" in str(told.exception)


def test_its_drive_is_replayed(capfd: pytest.CaptureFixture[str]) -> None:
    told = CliRunner().invoke(devkit_app, ["replay", str(HERE / "attempt")])
    assert told.exit_code == 0, told.output
    assert "yolov3-1300-clear, attempt 1: equal, 6 ticks" in told.stdout + capfd.readouterr().out


@pytest.mark.slow
def test_its_interventions_are_done_again() -> None:
    if device_class("cpu") != read_journal(HERE / "attempt")[0].device_class:
        pytest.skip(f"made on another class of device than {device_class('cpu')}")
    words = [sys.executable, "-m", "twin", "reenact", str(HERE / "attempt")]
    told = subprocess.run(words, capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    assert "the same values, to the last bit" in told.stdout


def test_a_head_with_a_case_that_is_none_is_damage(tmp_path: Path) -> None:
    text = (HERE / "attempt" / "interventions.jsonl").read_text()
    (tmp_path / "interventions.jsonl").write_text(text.replace('"scenario":{', '"scenery":{', 1))
    with pytest.raises(UsageError, match=r"interventions\.jsonl: damaged: "):
        read_journal(tmp_path)
