"""Fixtures of the end-to-end tests."""

import json
import os
import subprocess

import pytest
from processes import Marked, nothing_left


@pytest.fixture
def marked():
    """Starts processes; fails if anything is left behind, and kills it."""
    starter = Marked()
    try:
        with nothing_left(starter):
            yield starter
    finally:
        starter.end()


@pytest.fixture(scope="session")
def quiet(tmp_path_factory):
    """The campaign chaos-16 run once in peace: 1 worker x 1 slot."""
    folder = tmp_path_factory.mktemp("quiet") / "chaos-16"
    starter = Marked()
    try:
        done = starter.run(
            *("conductor", "run", "chaos-16", "--workers", "1", "--slots", "1"),
            *("--out", str(folder), "--output", "json"),
        )
        assert done.returncode == 1, done.stderr
        return {"folder": folder, **json.loads(done.stdout)}
    finally:
        starter.end()


@pytest.fixture(scope="session")
def local(tmp_path_factory):
    """``conductor run aeb-demo`` on this machine, without a scheduler."""
    folder = tmp_path_factory.mktemp("local") / "aeb-demo"
    starter = Marked()
    try:
        asked = ("conductor", "run", "aeb-demo", "--out", str(folder), "--output", "json")
        child = starter.start(*asked)
        out, err = child.communicate(timeout=500)
        assert child.returncode in (0, 1), err
        return {"folder": folder, "code": child.returncode, **json.loads(out)}
    finally:
        starter.end()


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 1 MiB."""
    folder = tmp_path / "small"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(command, capture_output=True).returncode:
        pytest.skip("needs root to mount a small tmpfs")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)
