"""`conductor bench-run`: real runs, of this installation and of itself as the other one."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from conductor.bench.runs import RunCost, bench_run
from twin.base.errors import InfrastructureError, UsageError


def test_two_installations_take_turns_and_are_compared(tmp_path, capfd):
    python = Path(sys.executable)
    assert bench_run(8, 1, python, tmp_path, as_json=True, check=False) == 0
    shown = json.loads(capfd.readouterr().out)
    assert shown["cases"] == 8
    here, other = (RunCost(**shown["runs"][name][0]) for name in ("here", "against"))
    assert [len(runs) for runs in shown["runs"].values()] == [1, 1]
    # Three interpreters start in a run, and none of them loads in a hundredth of a second.
    assert here.cpu_s > 0.03
    assert here.wall_s > 0
    assert shown["ratios"]["cpu_s"] == pytest.approx(other.cpu_s / here.cpu_s)
    assert shown["ratios"]["wall_s"] == pytest.approx(other.wall_s / here.wall_s)
    assert not list(tmp_path.iterdir())


def test_an_installation_that_takes_as_long_misses_the_target(tmp_path, monkeypatch, capfd):
    costs = iter([RunCost(9.0, 9.0), RunCost(9.0, 9.0), RunCost(1.0, 2.0), RunCost(2.9, 8.0)])
    monkeypatch.setattr("conductor.bench.runs._measure", lambda *_: next(costs))
    python = Path(sys.executable)
    assert bench_run(8, 1, python, tmp_path, as_json=False, check=True) == 1
    out, err = capfd.readouterr()
    assert "ratio cpu_s: 2.90\nratio wall_s: 4.00\n" in out
    assert err == "missed: the other one takes 2.90 times the processor time, the target is 3\n"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--cases", "9"], "--cases 9: give a multiple of 8"),
        (["--against", "/dev/null"], "--against /dev/null: not a program"),
        (["--against", "/usr/bin"], "--against /usr/bin: not a program"),
    ],
)
def test_bad_options_are_one_line(tmp_path, options, words):
    command = [sys.executable, "-m", "conductor", "bench-run", "--folder", str(tmp_path)]
    done = subprocess.run([*command, *options], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert words in done.stderr
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_run_that_fails_is_told_by_its_last_line(tmp_path):
    broken = tmp_path / "python"
    broken.write_text("#!/bin/sh\necho first >&2\necho why it does not work >&2\nexit 7\n")
    broken.chmod(0o755)
    runs = tmp_path / "runs"
    with pytest.raises(InfrastructureError, match=r"ended with 7: why it does not work$"):
        bench_run(8, 1, broken, runs, as_json=True, check=False)
    assert not list(runs.iterdir())


def test_no_program_is_no_interpreter(tmp_path):
    with pytest.raises(UsageError, match="not a program; give a Python interpreter"):
        bench_run(8, 1, tmp_path / "none", tmp_path, as_json=True, check=False)
