"""twin.world.kernel_loading and kernel_headers: who compiles what, and what is left behind."""

import fcntl
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

LOAD = """
import sys
import warp as wp
from twin.world.kernel_cache import prepare_kernels
from twin.world.kernel_loading import load_kernels
from twin.render.light import lamps
from twin.render.trace import rays
from twin.sensors.camera import boxes
from twin.sensors.vehicle_truth import vehicle_truth_kernel
prepare_kernels()
from warp._src import build
compiled = []
real = build.build_cpu
def build_cpu(output, source, *rest, **options):
    compiled.append(output)
    return real(output, source, *rest, **options)
build.build_cpu = build_cpu
print("ready", flush=True)
sys.stdin.readline()
load_kernels(wp.get_device("cpu"), [rays, lamps, boxes, vehicle_truth_kernel, rays])
print(len(compiled), flush=True)
sys.stdin.readline()
"""


@pytest.fixture
def started(tmp_path):
    """Starts processes that load four modules from one cache when told to."""
    running = []
    places = {"WARP_CACHE_PATH": str(tmp_path / "cache"), "TMPDIR": str(tmp_path / "temporary")}
    (tmp_path / "temporary").mkdir()

    def start():
        environment = {**os.environ, **places}
        environment.pop("XDG_RUNTIME_DIR", None)
        process = subprocess.Popen(
            [sys.executable, "-c", LOAD],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        running.append(process)
        assert process.stdout.readline() == "ready\n"
        return process

    yield start
    for process in running:
        process.kill()
        process.communicate()


def told(process):
    process.stdin.write("\n")
    process.stdin.flush()


def objects(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*.o"))


def test_processes_that_begin_together_share_the_work(started, tmp_path):
    both = [started(), started()]
    for process in both:
        told(process)
    counts = [int(process.stdout.readline()) for process in both]
    assert sum(counts) == 4, "each module is compiled once"
    assert min(counts) >= 1
    assert len(objects(tmp_path / "cache")) == 4
    third = started()
    told(third)
    assert third.stdout.readline() == "0\n"


def test_headers_go_with_a_process_that_is_killed(started, tmp_path):
    process = started()
    temporary = tmp_path / "temporary"
    assert not list(temporary.iterdir()), "nothing is compiled yet"
    told(process)
    assert process.stdout.readline() == "4\n"
    (folder,) = temporary.iterdir()
    assert folder.stat().st_mode & 0o777 == 0o700
    assert list(folder.rglob("*.pch"))
    process.send_signal(signal.SIGKILL)
    process.wait()
    until_s = time.monotonic() + 60.0
    while list(temporary.iterdir()):
        assert time.monotonic() < until_s
        time.sleep(0.05)


def test_a_module_that_another_process_holds_is_loaded_at_last(started, tmp_path):
    first = started()
    told(first)
    assert first.stdout.readline() == "4\n"
    (version,) = (path for path in (tmp_path / "cache").iterdir() if path.is_dir())
    held = next(path for path in (version / "locks").iterdir() if "lamps" in path.name)
    with held.open() as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        second = started()
        told(second)
        time.sleep(1.0)
        assert second.poll() is None
        fcntl.flock(file, fcntl.LOCK_UN)
        assert second.stdout.readline() == "0\n"


def test_a_cache_without_locks_is_used_all_the_same(started, tmp_path):
    first = started()
    (version,) = (path for path in (tmp_path / "cache").iterdir() if path.is_dir())
    (version / "locks").write_text("no folder")
    told(first)
    assert first.stdout.readline() == "4\n"
