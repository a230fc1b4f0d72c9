"""Flux against a made-up ``flux`` that really runs what it is given."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import PATIENCE_S, wait_for

ROOT = Path(__file__).resolve().parents[3]
FLUX = """#!/bin/bash
case "$1 $2" in
  "--version "*) echo "flux-core 0.1" ;;
  "batch --dry-run") grep -q '^# flux: --job-name=' ;;
  "batch "*)
    (bash "$3" > flux-f1.out 2>&1; echo $? > "$FLUX_FOLDER/code") > /dev/null 2>&1 &
    echo f1 ;;
  "jobs "*)
    if [ -e "$FLUX_FOLDER/code" ]; then echo "INACTIVE $(cat "$FLUX_FOLDER/code")"
    else echo "RUN -"; fi ;;
  "queue "*) echo batch ;;
  *) exit 2 ;;
esac
"""
CAMPAIGN = """\
campaign: short
render: false
camera: {width: 32, height: 18, hz: 10}
scenario: {duration_s: 0.5}
autonomy: {stack: "devkit.idle:IdleStack", perception: {none: {type: ground_truth}}}
matrix: {weather: [clear]}
"""


@pytest.fixture
def hpc(tmp_path):
    """Runs ``hpc`` where ``flux`` is a command."""
    program = tmp_path / "bin/flux"
    program.parent.mkdir()
    program.write_text(FLUX)
    program.chmod(0o755)
    (tmp_path / "short.yaml").write_text(CAMPAIGN)
    own = {
        "PATH": f"{program.parent}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "FLUX_FOLDER": str(tmp_path),
        "XDG_CONFIG_HOME": str(tmp_path),
        "DRIVETWIN_HOME": str(tmp_path / "home"),
    }

    def run(*words):
        command = [sys.executable, "-m", "hpc", *words]
        env = {**os.environ, **own}
        return subprocess.run(
            command, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=PATIENCE_S
        )

    return run


JOB = ("short.yaml", "--workers", "2", "--nodes", "1", "--time", "00:10", "--scheduler", "flux")


def test_a_campaign_runs_as_a_job(hpc, tmp_path):
    folder = Path(sys.executable).parent
    told = hpc("submit", *JOB, "--bin", str(folder), "--output", "json")
    assert told.returncode == 0, told.stderr
    said = json.loads(told.stdout)
    assert (said["scheduler"], said["job"]) == ("flux", "f1")
    wait_for((tmp_path / "code").exists, "the end of the job")
    log = next(tmp_path.rglob("flux-f1.out")).read_text()
    assert (tmp_path / "code").read_text() == "1\n", log  # who stands still passes nothing
    found = json.loads(next(tmp_path.rglob("outcomes.json")).read_text())
    assert found["complete"]
    status = hpc("status", "f1", "--scheduler", "flux")
    assert status.stdout.startswith("flux job f1: INACTIVE"), status.stdout + status.stderr


def test_more_nodes_are_refused_in_one_line(hpc):
    done = hpc("render", "short.yaml", "--workers", "2", "--time", "00:10", "--scheduler", "flux")
    assert (done.returncode, done.stderr) == (2, "hpc: Flux: one node so far; give --nodes 1\n")
