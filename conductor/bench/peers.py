"""The other two schedulers of the comparison, each in a fair configuration.

- **dask.distributed**: ``LocalCluster`` with two worker processes of one thread each, the dashboard
  off, in a process of its own; after a warm-up one ``client.map`` of pure no-op tasks whose futures
  are gathered. Nothing is durable: the scheduler keeps its tasks in memory.
- **HyperQueue**: its Python API's ``LocalCluster`` with two workers of one core each; after a
  warm-up one job with a no-op program per task (``true``), the cheapest task that it has: standard
  output and error are off and no task folders are made. A Python function would start an
  interpreter per task, which is slower. The journal is off, so nothing is durable.

Counted is the time from the submission until every task is done; both need the submission to
start. Tasks and processes are as many as ours. Each runs in a process that does nothing else, so
that their event loops do not meet ours.
"""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from conductor.bench.children import child
from conductor.bench.own import CLIENTS, SchedulerRun
from twin.base.process import bind_to_parent

PACKAGES = {"dask": "distributed", "hyperqueue": "hyperqueue"}
"""Peer -> package that it needs."""

WARM_UP = 100
"""Tasks before the clock starts."""


def missing(peer: str) -> str:
    """Why ``peer`` cannot run, in one line; empty if it can."""
    package = PACKAGES[peer]
    if importlib.util.find_spec(package) is None:
        return f"{peer}: package '{package}' is not installed; run `make install-bench`"
    return ""


def measure_peer(peer: str, tasks: int, folder: Path) -> SchedulerRun:
    """Run ``tasks`` no-op tasks with ``peer``, in a process of its own.

    Raises:
        InfrastructureError: it failed, with its last words.
    """
    scratch = Path(tempfile.mkdtemp(prefix=f"bench-{peer}-", dir=folder.absolute()))
    try:
        with child("conductor.bench.peers", peer, str(tasks), str(scratch)) as process:
            answer = json.loads(process.line())
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return SchedulerRun(tasks, answer["wall_s"])


def _noop(index: int) -> int:
    return index


def _dask(tasks: int, scratch: Path) -> float:
    dask, distributed = import_module("dask"), import_module("distributed")
    dask.config.set({"temporary-directory": str(scratch)})
    cluster = distributed.LocalCluster(
        n_workers=CLIENTS, threads_per_worker=1, processes=True, dashboard_address=None
    )
    with cluster, distributed.Client(cluster) as client:
        client.gather(client.map(_noop, range(WARM_UP), pure=False))
        started_s = time.perf_counter()
        client.gather(client.map(_noop, range(tasks), pure=False))
        return time.perf_counter() - started_s


def _hyperqueue(tasks: int, scratch: Path) -> float:
    hyperqueue = import_module("hyperqueue")
    one_core = import_module("hyperqueue.cluster").WorkerConfig(cores=1)
    program = shutil.which("true")
    assert program is not None

    def job(count: int) -> Any:
        made = hyperqueue.Job(scratch)
        for _ in range(count):
            made.program([program], stdout=None, stderr=None)
        return made

    with hyperqueue.LocalCluster(str(scratch / "server")) as cluster:
        for _ in range(CLIENTS):
            cluster.start_worker(one_core)
        client = cluster.client()
        client.wait_for_jobs([client.submit(job(WARM_UP))])
        measured = job(tasks)
        started_s = time.perf_counter()
        client.wait_for_jobs([client.submit(measured)])
        return time.perf_counter() - started_s


_RUN: dict[str, Callable[[int, Path], float]] = {"dask": _dask, "hyperqueue": _hyperqueue}


def _main() -> None:
    peer, tasks, scratch = sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])
    # HyperQueue leaves a folder below the temporary one for each cluster.
    os.environ["TMPDIR"] = str(scratch)
    # Peers print to descriptor 1, also from native code; the result alone goes there.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    wall_s = _RUN[peer](tasks, scratch)
    print(json.dumps({"wall_s": wall_s}), file=answers, flush=True)


if __name__ == "__main__":
    bind_to_parent()
    _main()
