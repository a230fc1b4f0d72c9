"""`conductor doctor` on machines that really lack something."""

import json
import os
import shutil
import socket
import subprocess
import sys

import pytest
from c_library import compiled

NOT_LOADED = """\
int nvmlInit_v2(void) { return 9; }
int nvmlInitWithFlags(unsigned int flags) { return 9; }
const char *nvmlErrorString(int code) { return "Driver Not Loaded"; }
"""
"""NVIDIA's library of a driver that is installed and not loaded."""


def asked(*words: str, **changed: str) -> tuple[int, dict[str, dict[str, str]]]:
    """Exit code, and lines by what they are about, of the doctor in a changed environment."""
    command = [sys.executable, "-m", "conductor", "doctor", "--output", "json", *words]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **changed})
    assert done.stdout, done.stderr
    said = json.loads(done.stdout)
    assert said["ready"] is (done.returncode == 0)
    return done.returncode, {line["what"]: line for line in said["lines"]}


def test_a_path_without_bubblewrap_and_a_port_that_is_taken(tmp_path):
    with socket.socket() as taken:
        taken.bind(("", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        _, lines = asked("--port", port, "--out", str(tmp_path), PATH=str(tmp_path))
    assert lines["sandbox"]["level"] == "warn"
    assert "bubblewrap" in lines["sandbox"]["do"]
    assert lines["sandbox"]["page"] == "docs/sandbox.md"
    assert lines["port"]["level"] == "warn"
    assert port in lines["port"]["found"]
    assert lines["batch system"]["found"] == "none"
    assert list(tmp_path.iterdir()) == []


def test_a_full_file_system(small_disk):
    code, lines = asked("--out", str(small_disk / "runs"))
    assert code == 3
    assert lines["space"]["level"] == "bad"
    assert lines["run folder"]["level"] == "warn", "it is gone after a restart"
    (small_disk / "full").write_bytes(bytes(shutil.disk_usage(small_disk).free))
    code, lines = asked("--out", str(small_disk / "runs"))
    assert lines["run folder"]["level"] == "bad"
    assert "No space left" in lines["run folder"]["found"]


def test_a_driver_that_is_not_loaded_and_no_vulkan(tmp_path):
    folder = compiled(tmp_path, "libnvidia-ml.so.1", NOT_LOADED)
    code, lines = asked(LD_LIBRARY_PATH=str(folder), VK_DRIVER_FILES="/nowhere")
    assert code == 3
    assert lines["GPU"]["level"] == "bad"
    assert "Driver Not Loaded" in lines["GPU"]["found"]
    assert lines["GPU"]["page"] == "docs/gpu.md"
    assert lines["Vulkan"]["level"] == "warn"


def test_a_cache_that_others_may_write_to(tmp_path):
    cache = tmp_path / "cache"
    cache.mkdir()
    cache.chmod(0o777)
    code, lines = asked(TWIN_CACHE=str(cache))
    assert code == 3
    assert "others may write to it" in lines["cache"]["found"]


def test_people_read_what_to_do_and_where():
    done = subprocess.run(
        [sys.executable, "-m", "conductor", "doctor"],
        capture_output=True,
        text=True,
        env={**os.environ, "PATH": "/nowhere"},
    )
    assert done.returncode in (0, 3)
    lines = done.stdout.splitlines()
    place = next(n for n, line in enumerate(lines) if line.startswith("warn  sandbox"))
    assert "see docs/sandbox.md" in lines[place + 1]
    assert lines[-1].startswith("this machine is ")
    assert not done.stderr


@pytest.mark.parametrize("words", [("--port", "0"), ("--port", "70000"), ("--nothing",)])
def test_bad_input_is_refused(words):
    done = subprocess.run(
        [sys.executable, "-m", "conductor", "doctor", *words], capture_output=True, text=True
    )
    assert done.returncode == 2
    assert words[0] in done.stderr
