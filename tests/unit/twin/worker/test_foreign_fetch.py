"""The files of a stack are fetched where it runs, and nothing of that outlives the worker."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from schemas.sections.foreign import Repository
from twin.base.errors import InfrastructureError
from twin.base.fetch import fetch
from twin.base.process import end, spawn
from twin.worker.rig_process import runs_fetch


def ended(pid):
    """Whether a process is gone, or would be if somebody waited for it."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def test_a_fetch_ends_with_its_worker(tmp_path):
    who = ("-c", "user.name=t", "-c", "user.email=t@example.org")
    subprocess.run(["git", *who, "init", "-q", tmp_path / "source"], check=True)
    words = ["git", *who, "commit", "-q", "--allow-empty", "-m", "one"]
    subprocess.run(words, cwd=tmp_path / "source", check=True)
    told = tmp_path / "told"
    os.mkfifo(told)
    setup = f"echo $$ > {told}; exec sleep 600"
    foreign = {"command": ["x"], "repository": {"url": str(tmp_path / "source"), "setup": setup}}
    words = [*("--connect", "tcp/127.0.0.1:1", "--rig", "r"), "--foreign", json.dumps(foreign)]
    host = spawn(
        [sys.executable, "-m", "devkit", "host", *words],
        environment={"TWIN_CACHE": str(tmp_path / "cache")},
    )
    pid = int(told.read_text())  # the set-up runs
    assert runs_fetch(host.pid)
    end(host, 30.0)
    assert not runs_fetch(host.pid)
    while not ended(pid):
        pass  # the signal is on its way


def test_an_address_is_no_option():
    with pytest.raises(InfrastructureError, match="leading '-'"):
        fetch(Repository(url="--help"))


def test_a_container_that_was_killed_is_removed_by_its_name(tmp_path, monkeypatch):
    """With what stands in for podman: it says how it is called, and runs the command."""
    tool, said = tmp_path / "podman", tmp_path / "said"
    tool.write_text(f'#!/bin/sh\necho "$@" >> {said}\n[ "$1" = rm ] || exec sleep 600\n')
    tool.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.chdir(tmp_path)
    foreign = {"command": ["x"], "image": {"path": "org/name:1", "runtime": "podman"}}
    words = [*("--connect", "tcp/127.0.0.1:1", "--rig", "r7"), "--foreign", json.dumps(foreign)]
    host = spawn([sys.executable, "-m", "devkit", "host", *words, "--stack", ""])
    while not said.exists() or "--name=drivetwin-r7 --replace" not in said.read_text():
        assert host.poll() is None
    end(host, 60.0)
    assert said.read_text().splitlines()[-1] == "rm --force --ignore --time=0 drivetwin-r7"
