"""A conductor for several people gives no case to a worker without a sandbox, unless it is told to.

Real processes; the worker's ``PATH`` lacks bubblewrap, as on a machine where it is not installed.
"""

import json
import os
from pathlib import Path

import pytest
import yaml
from waiting import PATIENCE_S, wait_for

from twin.base.errors import TwinError
from twin.fabric.discovery import find_conductor
from twin.sandbox.start import PROGRAM

NOOP = {"campaign": "small", "simulator": "noop", "matrix": {"repeat": [0, 1, 2]}}


@pytest.fixture
def without_sandbox(tmp_path, monkeypatch):
    """All commands but one."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for place in os.environ["PATH"].split(os.pathsep):
        for program in Path(place).iterdir() if Path(place).is_dir() else ():
            if program.name != PROGRAM and not (folder / program.name).is_symlink():
                (folder / program.name).symlink_to(program)
    monkeypatch.setenv("PATH", str(folder))


@pytest.mark.parametrize("allowed", [False, True], ids=["", "--allow-unprotected"])
def test_a_worker_without_a_sandbox(marked, tmp_path, without_sandbox, allowed):
    state, path = tmp_path / "state", tmp_path / "small.yaml"
    path.write_text(yaml.safe_dump(NOOP))
    options = ["--allow-unprotected"] if allowed else []
    where = ("--state", str(state))
    with (tmp_path / "serve.log").open("w") as log:
        served = marked.start(
            *("conductor", "serve", *where, "--listen", "tls/0.0.0.0:0", *options), log=log
        )

    def listens():
        try:
            return find_conductor(state).pid == served.pid
        except TwinError:
            assert served.poll() is None, (tmp_path / "serve.log").read_text()
            return False

    def asked(*words):
        done = marked.run("conductor", *words, *where)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def row():
        return json.loads(asked("status", "--output", "json"))["campaigns"]["small"]

    wait_for(listens, "the conductor")
    asked("submit", str(path))
    with (tmp_path / "worker.log").open("w") as log:
        worker = marked.start("twin", "worker", *where, "--slots", "2", log=log)
    said = "has no sandbox for stacks, no bwrap on this machine"
    if allowed:
        wait_for(lambda: not row()["left"], "the end of all cases")
    else:
        wait_for(lambda: said in asked("explain", "small", "repeat_0"), "the worker's refusal")
        assert (row()["left"], row()["attempts"]) == (3, 0)
    for child in (worker, served):
        child.terminate()
        child.wait(PATIENCE_S)
