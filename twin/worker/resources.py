"""What a worker's processes, its node and its GPU use now; see schemas.files.resources."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import psutil

from schemas.files.resources import ProcessUse, ResourceSample
from twin.worker.held import CampaignWork
from twin.worker.resources_gpu import Gpu

_ROLES = {
    ("twin", "worker"): "worker",
    ("twin", "sim"): "simulator",
    ("devkit", "host"): "stack",
    ("viewer", "record"): "recorder",
}


@dataclass(frozen=True, slots=True)
class ProcessReading:
    """Counters of one process."""

    role: str
    pid: int
    born_s: float
    """Start of the process on the wall clock; tells it from another one with its pid [s]."""
    cpu_s: float
    """CPU time since it started [s]."""
    rss_bytes: int


class Meter:
    """Measures the process ``pid`` and its descendants, the node, and one GPU.

    CPU use is that since the reading before, so the first sample knows none.
    """

    def __init__(self, worker: str, host: str, device: str, pid: int | None = None) -> None:
        self._worker = worker
        self._host = host
        self._root = psutil.Process(pid or os.getpid())
        self._gpu = Gpu(device)
        self._before: list[ProcessReading] | None = None
        self._before_ns = 0

    def sample(
        self, work: Sequence[CampaignWork], time_ns: int, now_ns: int
    ) -> list[ResourceSample]:
        """One sample per campaign that the worker holds cases of; without work only the counters
        are read.

        Args:
            work: cases in hand, by campaign.
            time_ns: wall clock [ns].
            now_ns: monotonic clock [ns].
        """
        readings = read_tree(self._root)
        elapsed_s = (now_ns - self._before_ns) * 1e-9
        processes = used(self._before, readings, elapsed_s)
        first = self._before is None
        self._before, self._before_ns = readings, now_ns
        busy = psutil.cpu_percent(interval=None)  # since the call before, in this thread
        if not work:
            return []
        cpus = psutil.cpu_count() or 1
        memory = psutil.virtual_memory()
        known = [process.cpu_cores for process in processes if process.cpu_cores is not None]
        gpu = self._gpu.read()
        return [
            ResourceSample(
                time_ns=time_ns,
                host=self._host,
                worker=self._worker,
                batch=campaign.batch,
                cases=campaign.cases,
                cpu_cores=sum(known) if known else None,
                ram_bytes=sum(process.rss_bytes for process in processes),
                processes=processes,
                node_cpus=cpus,
                node_cpu_cores=None if first else busy / 100 * cpus,
                node_ram_bytes=memory.total - memory.available,
                node_ram_total_bytes=memory.total,
                gpu=gpu.uuid,
                gpu_name=gpu.name,
                gpu_percent=gpu.percent,
                gpu_memory_bytes=gpu.memory_bytes,
                gpu_memory_total_bytes=gpu.memory_total_bytes,
                gpu_power_w=gpu.power_w,
            )
            for campaign in work
        ]


def used(
    before: Sequence[ProcessReading] | None, now: Sequence[ProcessReading], elapsed_s: float
) -> list[ProcessUse]:
    """CPU use between two readings, ``elapsed_s`` apart.

    A process that was born in between has used all of its CPU time in between. What a process that
    ended used since the reading before is lost.
    """
    known = {(reading.pid, reading.born_s): reading.cpu_s for reading in before or ()}
    uses = []
    for reading in now:
        cores = None
        if before is not None and elapsed_s > 0:
            spent_s = reading.cpu_s - known.get((reading.pid, reading.born_s), 0.0)
            cores = max(0.0, spent_s / elapsed_s)
        uses.append(
            ProcessUse(
                role=reading.role, pid=reading.pid, cpu_cores=cores, rss_bytes=reading.rss_bytes
            )
        )
    return uses


def read_tree(root: psutil.Process) -> list[ProcessReading]:
    """Counters of ``root`` and its descendants; what ends meanwhile is left out."""
    readings = []
    for process in (root, *root.children(recursive=True)):
        try:
            with process.oneshot():
                times = process.cpu_times()
                readings.append(
                    ProcessReading(
                        role=_role(process),
                        pid=process.pid,
                        born_s=process.create_time(),
                        cpu_s=times.user + times.system,
                        rss_bytes=process.memory_info().rss,
                    )
                )
        except (psutil.NoSuchProcess, psutil.AccessDenied):
            continue
    return readings


def _role(process: psutil.Process) -> str:
    line = process.cmdline()
    for index, word in enumerate(line[:-2]):
        if word == "-m" and (role := _ROLES.get((line[index + 1], line[index + 2]))):
            return role
    if len(line) > 2 and (role := _ROLES.get((line[1].rpartition("/")[2], line[2]))):
        return role  # started as the command `twin worker`
    return str(process.name())
