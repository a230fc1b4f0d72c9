"""``devkit replay`` of a record that came from somebody: its command is shown, not run."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from case_changes import changed

from schemas import SCHEMA_VERSION
from schemas.files.drive_record import RecordHead, RecordSeen
from schemas.plan import parse_plan
from schemas.sections.foreign import Foreign, Repository
from twin.records.drive_record import RecordWriter

SECONDS = ["--deadline-s", "5"]


def record(folder: Path, foreign: Foreign | None) -> Path:
    plan, mistakes = parse_plan({"campaign": "c", "matrix": {"weather": ["clear"]}})
    assert plan is not None, mistakes
    cases = plan.cases
    stack = "" if foreign else cases[0].rig.stack
    case = changed(cases[0], stack=stack, foreign=foreign)
    attempt = folder / "cases/clear/attempt-1"
    head = RecordHead(SCHEMA_VERSION, 1, "", "cpu", 1, case)
    writer = RecordWriter(attempt / "drive.record", head)
    writer.write(RecordSeen(tick=0, sim_time_ns=0, sensors={}))
    writer.close()
    return attempt


def replay(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "devkit", "replay", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
    )


@pytest.fixture
def touching(tmp_path: Path) -> Foreign:
    return Foreign(["/bin/sh", "-c", f"touch {tmp_path}/RAN; exit 1"])


def test_its_command_is_shown_and_not_run(tmp_path: Path, touching: Foreign) -> None:
    attempt = record(tmp_path, touching)
    for given in (".", str(attempt), str(attempt / "drive.record")):
        done = replay(tmp_path, given, *SECONDS)
        assert done.returncode == 2, done.stderr
        assert len(done.stderr.splitlines()) == 1
        assert f"`/bin/sh -c 'touch {tmp_path}/RAN; exit 1'`" in done.stderr
        assert "give --run-command" in done.stderr
        assert not (tmp_path / "RAN").exists()


def test_it_is_run_for_those_who_ask(tmp_path: Path, touching: Foreign) -> None:
    record(tmp_path, touching)
    done = replay(tmp_path, ".", "--run-command", *SECONDS)
    assert (tmp_path / "RAN").exists(), done.stderr


def test_one_among_others_is_found_before_any_is_shown(tmp_path: Path, touching: Foreign) -> None:
    record(tmp_path, None)
    late = tmp_path / "cases/rain/attempt-1"
    late.mkdir(parents=True)
    record(tmp_path / "other", touching).joinpath("drive.record").rename(late / "drive.record")
    done = replay(tmp_path, ".", *SECONDS)
    assert done.returncode == 2
    assert done.stdout == ""
    assert "cases/rain" in done.stderr
    assert not (tmp_path / "RAN").exists()


def test_what_it_hides_is_shown_on_one_line(tmp_path: Path) -> None:
    cursor = Foreign(
        ["/bin/sh", "-c", "true #\n\x1b[2Jall is well" + "x" * 4000],
        repository=Repository("https://evil.example/x.git"),
    )
    record(tmp_path, cursor)
    done = replay(tmp_path, ".", *SECONDS)
    assert done.returncode == 2
    assert "\x1b" not in done.stderr
    assert "https://evil.example/x.git" in done.stderr
    assert "give --run-command" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert len(done.stderr) < 1500


def test_a_stack_of_ones_own_needs_no_word(tmp_path: Path, touching: Foreign) -> None:
    record(tmp_path, touching)
    done = replay(tmp_path, ".", "--stack", "devkit.aeb:AebStack", *SECONDS)
    assert done.returncode in (0, 1), done.stderr
    assert "clear, attempt 1: " in done.stdout
    assert not (tmp_path / "RAN").exists()
