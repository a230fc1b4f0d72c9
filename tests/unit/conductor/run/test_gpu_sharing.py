"""conductor.run.gpu_sharing: a service of the run's own, and its end. The real one needs a GPU
(``tests/device/campaign_check.py``); here a script with its name notes what it is told."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest
from waiting import wait_for

from conductor.run.gpu_sharing import LOGS_VARIABLE, PROGRAM, side_by_side
from twin.base.gpu.first_use import PIPES_VARIABLE


@pytest.fixture
def service(tmp_path, monkeypatch):
    """Puts a program on the path that appends its arguments and input to a file; what it noted."""
    notes = tmp_path / "notes"

    def install(start: str = "exit 0"):
        program = tmp_path / "bin" / PROGRAM
        program.parent.mkdir(exist_ok=True)
        program.write_text(
            f'#!/bin/sh\necho "$@ devices=$CUDA_VISIBLE_DEVICES at=${PIPES_VARIABLE}" >> {notes}\n'
            f'if [ "$1" = -d ]; then {start}; fi\ncat >> {notes}\n'
        )
        program.chmod(0o755)

    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.delenv(PIPES_VARIABLE, raising=False)
    install()
    return SimpleNamespace(
        install=install, told=lambda: notes.read_text() if notes.exists() else ""
    )


def folders(tmp_path):
    return list(tmp_path.glob("drivetwin-mps-*"))


def test_processes_find_the_service_while_it_lasts(service, tmp_path, monkeypatch):
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "3")
    with side_by_side("cuda:0") as computed:
        (folder,) = folders(tmp_path)
        assert os.environ[PIPES_VARIABLE] == os.environ[LOGS_VARIABLE] == str(folder)
        # Its clients count devices by this variable; with it the service would count them, too.
        assert service.told().startswith(f"-d devices= at={folder}\n")
        wait_for(lambda: "start_server" in service.told(), "the server is started")
        computed()
        wait_for(lambda: "quit" in service.told(), "the service was told to end")
    assert PIPES_VARIABLE not in os.environ
    assert LOGS_VARIABLE not in os.environ
    assert service.told().splitlines()[1:] == [
        f" devices= at={folder}",
        f"start_server -uid {os.getuid()}",
        f" devices= at={folder}",
        "quit -t 10",
    ]
    assert folders(tmp_path) == []


def test_it_ends_with_a_run_that_is_killed(service, tmp_path):
    code = (
        "import time\nfrom conductor.run.gpu_sharing import side_by_side\n"
        "with side_by_side('cuda:0'):\n    print('on', flush=True)\n    time.sleep(600)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as run:
        assert run.stdout.readline() == b"on\n"
        assert len(folders(tmp_path)) == 1
        wait_for(lambda: "start_server" in service.told(), "the server is started")
        run.send_signal(signal.SIGKILL)
    wait_for(lambda: folders(tmp_path) == [], "the service's folder is gone")
    assert service.told().endswith("quit -t 10\n")


def test_one_that_does_not_start_is_one_line(service, tmp_path, capsys):
    service.install("echo no driver here >&2; exit 7")
    with side_by_side("cuda:0"):
        assert PIPES_VARIABLE not in os.environ
    assert capsys.readouterr().err == f"processes on a GPU take turns: {PROGRAM}: no driver here\n"
    assert folders(tmp_path) == []


@pytest.mark.parametrize("reason", ["switched off", "the user's own", "not installed", "a CPU"])
def test_nothing_is_started_where_it_is_not_wanted(service, tmp_path, monkeypatch, capsys, reason):
    if reason == "switched off":
        monkeypatch.setenv("TWIN_MPS", "off")
    elif reason == "the user's own":
        monkeypatch.setenv(PIPES_VARIABLE, "/somewhere")
    elif reason == "not installed":
        monkeypatch.setenv("PATH", "/usr/bin:/bin")
    before = dict(os.environ)
    with side_by_side("cpu" if reason == "a CPU" else "cuda:0"):
        assert folders(tmp_path) == []
        assert dict(os.environ) == before
    assert service.told() == ""
    assert capsys.readouterr().err == ""
