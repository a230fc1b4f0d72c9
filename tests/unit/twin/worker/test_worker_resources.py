"""The resource log of a worker: what it measures, when, and where it writes."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import msgspec
import psutil
import pytest

from schemas.files.resources import PERIOD_S, ResourceSample
from twin.base.gpu.nvml import visible_device
from twin.worker.held import CampaignWork
from twin.worker.resources import Meter, ProcessReading, read_tree, used
from twin.worker.resources_gpu import Gpu, GpuReading
from twin.worker.resources_log import ResourceLog, append_sample, until_next, work_of


def reading(pid, cpu_s, born_s=1.0, rss=100):
    return ProcessReading(role="stack", pid=pid, born_s=born_s, cpu_s=cpu_s, rss_bytes=rss)


def test_the_first_reading_knows_no_cpu_use():
    (found,) = used(None, [reading(1, 5.0)], 3.0)
    assert found.cpu_cores is None
    assert found.rss_bytes == 100


def test_cpu_use_is_the_difference():
    found = used([reading(1, 5.0), reading(2, 1.0)], [reading(1, 7.5), reading(3, 1.0)], 5.0)
    assert [each.cpu_cores for each in found] == [0.5, 0.2]


def test_a_pid_that_was_used_again_is_another_process():
    (found,) = used([reading(1, 50.0)], [reading(1, 1.0, born_s=2.0)], 5.0)
    assert found.cpu_cores == 0.2


def test_no_time_between_readings_is_no_division_by_zero():
    (found,) = used([reading(1, 5.0)], [reading(1, 5.0)], 0.0)
    assert found.cpu_cores is None


@pytest.mark.parametrize(
    ("index", "visible", "expected"),
    [
        (0, None, 0),
        (1, None, 1),
        (0, "3", 3),
        (1, "2, 5", 5),
        (0, "GPU-8a1b", "GPU-8a1b"),
        (0, "MIG-12", "MIG-12"),
        (0, "", 0),
        (2, "0,1", 2),
    ],
)
def test_the_gpu_is_the_one_that_cuda_sees(index, visible, expected):
    assert visible_device(index, visible) == expected


@pytest.mark.parametrize("device", ["cpu", "cuda:777"])
def test_no_gpu_is_unknown_and_not_zero(device):
    gpu = Gpu(device)
    assert gpu.read() == GpuReading()


def test_a_real_tree_is_measured():
    """A parent with a child that burns: both are in the sample, with what they used."""
    burner = "import time\nprint(flush=True)\nwhile True: pass"
    parent = subprocess.Popen(
        [
            sys.executable,
            "-c",
            f"import subprocess, sys\nsubprocess.run([sys.executable, '-c', {burner!r}])",
        ],
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        assert parent.stdout.readline()
        meter = Meter("w1", "here", "cpu", parent.pid)
        assert meter.sample((), 0, time.monotonic_ns()) == []
        before = sum(each.cpu_s for each in read_tree(psutil.Process(parent.pid)))
        while sum(each.cpu_s for each in read_tree(psutil.Process(parent.pid))) <= before:
            pass
        work = (CampaignWork("/a", 2, 3), CampaignWork("/b", 1, 0))
        first, second = meter.sample(work, 7, time.monotonic_ns())
    finally:
        for child in psutil.Process(parent.pid).children():
            child.kill()
        parent.wait()
        parent.stdout.close()
    assert (first.host, first.worker, first.time_ns) == ("here", "w1", 7)
    assert (first.cases, first.batch, second.cases, second.batch) == (2, 3, 1, 0)
    assert len(first.processes) == 2
    assert 0 < first.cpu_cores == sum(each.cpu_cores for each in first.processes)
    assert first.ram_bytes == sum(each.rss_bytes for each in first.processes) > 1_000_000
    assert first.node_cpus == psutil.cpu_count()
    assert 0 < first.node_ram_bytes < first.node_ram_total_bytes
    assert (first.gpu, first.gpu_percent, first.gpu_memory_bytes) == (None, None, None)


def test_all_workers_sample_at_the_same_moments():
    period_ns = PERIOD_S * 10**9
    assert until_next(3 * period_ns) == PERIOD_S
    assert until_next(3 * period_ns + 10**9) == PERIOD_S - 1
    assert until_next(4 * period_ns - 1) == pytest.approx(1e-9)


def lease(out, batch):
    return SimpleNamespace(out=out, case=SimpleNamespace(variation=SimpleNamespace(batch=batch)))


def test_work_is_told_by_campaign():
    found = work_of([lease("/a", 1), lease("/b", 2), lease("/a", 1), lease("/b", 3)])
    assert found == (CampaignWork("/a", 2, 1), CampaignWork("/b", 2, 0))
    assert work_of([]) == ()


def sample():
    meter = Meter("w1", "here", "cpu", os.getpid())
    return meter.sample((CampaignWork("/a", 1, 0),), 5, time.monotonic_ns())[0]


def test_a_part_grows_line_by_line(tmp_path: Path):
    path = tmp_path / "resources" / "w1.jsonl"
    one = sample()
    append_sample(path, one)
    append_sample(path, one)
    lines = path.read_bytes().splitlines()
    assert [msgspec.json.decode(line, type=ResourceSample) for line in lines] == [one, one]


def test_a_log_that_cannot_be_written_says_so_once(tmp_path: Path):
    said: list[str] = []
    log = ResourceLog("w1", "here", "cpu", said.append)
    one = sample()
    log._append(tmp_path / "gone", one)
    log._append(tmp_path / "gone", one)
    assert len(said) == 1
    assert "No such file" in said[0]
    assert "gap" in said[0]


def test_it_samples_nothing_without_work_and_ends(tmp_path: Path):
    before = {*threading.enumerate()}
    log = ResourceLog("w1", "here", "cpu", pytest.fail)
    log.start()
    log.close()
    assert {*threading.enumerate()} <= before
    assert list(tmp_path.iterdir()) == []
