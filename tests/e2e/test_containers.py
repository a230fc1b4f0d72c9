"""Campaigns inside real containers of the runtimes that this machine has.

The image borrows the host's system, so it takes no time to make; test_offline.py has the image that
users get.
"""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from container_images import missing, prepared, python_folders, shell_image
from processes import committed, wait_for

from hpc.software.container import COMMANDS, Container

CHECKOUT = Path(__file__).parents[2]


@pytest.fixture(params=["apptainer", "charliecloud"])
def borrowed(request, tmp_path, monkeypatch):
    """Words before a command that run it in an image which borrows the host's system."""
    if reason := missing(COMMANDS[request.param]):
        pytest.skip(reason)
    monkeypatch.setenv("USER", os.environ.get("USER", "root"))  # charliecloud asks for it
    monkeypatch.setenv("APPTAINER_USERNS", "1")  # what an ordinary user gets anyway
    image = shell_image(tmp_path / "image")
    # The home folder stays outside, so the kernels that were compiled before have to be named.
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "warp"
    cache.mkdir(parents=True, exist_ok=True)
    monkeypatch.setenv("WARP_CACHE_PATH", str(cache))
    binds = (*python_folders(), str(CHECKOUT), str(tmp_path), str(cache))
    words = prepared(
        Container(image=str(image), runtime=request.param, binds=binds, folder=str(tmp_path))
    )
    # ch-run shows $TMPDIR as /tmp, and the folders of this test lie below the real one.
    return ("env", "--unset=TMPDIR", *words)


def test_the_same_results_inside(marked, quiet, tmp_path, borrowed):
    folder = tmp_path / "c"
    child = marked.start(
        *("conductor", "run", "chaos-16", "--workers", "1", "--slots", "4"),
        *("--out", str(folder), "--output", "json"),
        prefix=borrowed,
    )
    out, err = child.communicate()
    assert out, err
    assert child.returncode == 1, err
    assert json.loads(out)["fingerprint"] == quiet["fingerprint"]


def test_sigterm_reaches_the_conductor_inside(marked, tmp_path, borrowed):
    """As a job script forwards it: to the process that it started."""
    folder = tmp_path / "c"
    child = marked.start(
        "conductor", "run", "chaos-16", "--out", str(folder), "--workers", "1", prefix=borrowed
    )
    wait_for(lambda: committed(folder) >= 2, "two cases")
    child.send_signal(signal.SIGTERM)
    _, err = child.communicate()
    assert child.returncode == 75, err
    assert "the same command goes on" in err


def test_variables_of_the_job_come_in_and_those_of_python_do_not(borrowed):
    show = "import os; print(sorted(k for k in os.environ if os.environ[k]))"
    job = {
        "CUDA_VISIBLE_DEVICES": "2",
        "SLURM_JOB_ID": "7",
        "TWIN_PARENT_PID": "1",
        "PYTHONPATH": "/x",
    }
    done = subprocess.run(
        [*borrowed, sys.executable, "-c", show],
        env={**os.environ, **job},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "CUDA_VISIBLE_DEVICES" in done.stdout
    assert "SLURM_JOB_ID" in done.stdout
    assert "TWIN_PARENT_PID" in done.stdout
    assert "PYTHONPATH" not in done.stdout
