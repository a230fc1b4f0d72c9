"""Cores of a worker, what it explains, and frames in memory that is not here."""

import os
import subprocess
import sys

import numpy as np
import pytest

from schemas import SCHEMA_VERSION
from schemas.messages import Frame, Ready
from schemas.wire.codec import WireError
from twin.base.errors import UsageError
from twin.base.gpu import cuda
from twin.fabric.drive import StackEnd
from twin.fabric.memory_bus import MemoryHub
from twin.worker.allocation import WALLTIME_VARIABLE, parse_cores, walltime_s


def test_lists_of_cores():
    assert parse_cores("0-3,8") == {0, 1, 2, 3, 8}
    assert parse_cores("7") == {7}


@pytest.mark.parametrize("text", ["", "a", "3-1", "1,,2", "-1", "1-", "1 2"])
def test_other_lists_are_refused(text):
    with pytest.raises(UsageError, match="expected numbers and ranges"):
        parse_cores(text)


@pytest.mark.parametrize("text", ["soon", "nan", "inf", "1e301", "-1e301"])
def test_a_walltime_that_is_no_duration_is_refused(monkeypatch, text):
    monkeypatch.setenv(WALLTIME_VARIABLE, "90.5")
    assert walltime_s() == 90.5
    monkeypatch.setenv(WALLTIME_VARIABLE, text)
    with pytest.raises(UsageError, match="a number of seconds up to 1e"):
        walltime_s()


def test_a_worker_that_a_run_starts_reads_no_command_line():
    """What it loads for that takes longer than anything else at its start."""
    modules = "twin.worker.preload, twin.worker.shell, twin.fabric.discovery"
    told = f"import sys, {modules}; print({{'typer', 'rich', 'yaml'}} & {{*sys.modules}})"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True)
    assert done.stdout == "set()\n", done.stderr


def twin(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "twin", *arguments], capture_output=True, text=True
    )


def test_a_worker_explains_how_frames_travel():
    core = min(os.sched_getaffinity(0))
    done = twin("worker", "--explain", "--cores", str(core))
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert "frames travel by memory" in lines[0]
    assert [line.partition(":")[0] for line in lines[1:]] == ["device", "memory", "bytes"]
    assert "no GPU" in lines[1]
    refused = twin("worker", "--explain", "--cores", "9999")
    assert refused.returncode == 2
    assert f"allowed: {core}" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1


def test_a_cpu_offers_no_device_memory():
    assert cuda.offer("cpu") is None


def test_a_handle_that_cannot_be_opened_is_done_without():
    """What a simulator on another host, or of another GPU, would offer."""
    assert not cuda.proves(bytes(64), "a" * 32, "cuda:0")
    stack = StackEnd(MemoryHub().open(), "r", 1)
    stack.takes_device_frames = True
    offer = Ready(
        *(SCHEMA_VERSION, "simulator", "r", 1), gpu="cuda:0", gpu_handle=b"x" * 64, gpu_nonce="n"
    )
    stack._open(offer)
    assert not stack._gpu


def test_a_frame_behind_a_handle_that_was_not_agreed_on_is_refused():
    stack = StackEnd(MemoryHub().open(), "r", 1)
    frame = Frame(
        v=SCHEMA_VERSION,
        type="camera",
        seq=0,
        active=[True],
        case=["c"],
        token=[1],
        tick=[0],
        sim_time_ns=[0],
        dtype="|u1",
        shape=[1, 2, 2, 3],
        encoding="rgb8",
        handle=b"x" * 64,
    )
    with pytest.raises(WireError, match="did not open"):
        stack._array(frame, np.zeros(12, np.uint8).tobytes())
