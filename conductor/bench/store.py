"""``conductor bench-store``: what a result store costs a conductor, and how long a takeover takes.

The same campaign of cases that simulate nothing, with results as large as a simulator's, without a
store and with one; and a smaller one whose replies wait for the store. Two clients put their
results first, so the rate with a store is that of two lines to it; what the conductor has to do
is its processor time. After the second run the conductor is killed, and another with an empty
folder takes over.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import signal
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil
from rich.console import Console
from rich.table import Table

from conductor.bench.children import serving
from conductor.bench.own import check_disk, work
from conductor.bench.scale import POINTS, large_campaign
from conductor.commands.client import ConductorClient
from twin.base.errors import EXIT_FAILED, EXIT_PASS, InfrastructureError

TAKEOVER_S_MAX = 30.0
"""--check: most time of a takeover, the watch of the old owner included [s]."""
CPU_RATIO_MAX = 2.0
"""--check: most processor time of a conductor with a store, as a multiple of that without [-]."""
MEMORY_MORE_MAX_MB = 200.0
"""--check: most memory that a conductor with a store has beyond one without [MB]; libraries of an
object store take 40, outcomes on their way there twice their size."""
K = 256
"""Cases per request."""
DURABLE_SHARE = 20
"""Replies wait for the store in a campaign of one case in so many."""
PATIENCE_S = 300.0
"""Longest wait for a takeover [s]."""


@dataclass(frozen=True, slots=True)
class StoreCost:
    """What was measured with ``cases`` cases."""

    cases: int
    plain_rate: float
    """Cases per second without a store."""
    rate: float
    """The same with one, replies waiting for the disk."""
    durable_rate: float
    """The same, replies waiting for the store."""
    plain_cpu_s: float
    """Processor time of the conductor without a store, start and submission included [s]."""
    cpu_s: float
    """The same with one [s]."""
    plain_mb: float
    """Memory of the conductor after the last commit, without a store [MB]."""
    mb: float
    """The same with one [MB]."""
    takeover_s: float
    """Time from the start of a successor until it answers [s]."""
    left: int
    """Cases that run again, because the store had neither their facts nor their results."""

    def misses(self) -> list[str]:
        """Targets that were missed, one line each."""
        lines = []
        for name, value, most in (
            ("takeover_s", self.takeover_s, TAKEOVER_S_MAX),
            ("cpu_s", self.cpu_s, CPU_RATIO_MAX * self.plain_cpu_s),
            ("mb", self.mb, self.plain_mb + MEMORY_MORE_MAX_MB),
        ):
            if value > most:
                lines.append(f"{name} is {value:.1f}, the target is {most:.1f}")
        return lines


def bench_store(cases: int, url: str, folder: Path, *, as_json: bool, check: bool) -> int:
    """Measure and print; the exit code.

    Args:
        cases: cases of the campaign.
        url: result store; a prefix of its own below it is used, and stays.
        folder: where journals are written, on a real disk.
        as_json: one JSON object instead of a table.
        check: exit code 1 when a target is missed.
    """
    check_disk(folder)
    made = measure_store(cases, f"{url.rstrip('/')}/bench-{secrets.token_hex(4)}", folder)
    misses = made.misses()
    if as_json:
        print(json.dumps({**asdict(made), "misses": misses}))
    else:
        table = Table("what", "measured", title=f"a campaign of {cases} cases in {url}")
        for name, value in asdict(made).items():
            table.add_row(name, f"{value:.1f}" if isinstance(value, float) else str(value))
        Console().print(table)
    for line in misses:
        print(f"missed: {line}", file=sys.stderr)
    return EXIT_FAILED if check and misses else EXIT_PASS


def measure_store(cases: int, url: str, folder: Path) -> StoreCost:
    """See the module; in new state folders below ``folder``."""
    state = Path(tempfile.mkdtemp(prefix="bench-", dir=folder))
    few = max(POINTS, cases // DURABLE_SHARE // POINTS * POINTS)
    try:
        _say(f"{cases} cases without a store")
        plain_rate, plain_cpu_s, plain_mb = _run(state / "plain", cases)
        _say(f"{plain_rate:.0f}/s; with a store")
        rate, cpu_s, mb = _run(state / "first", cases, f"{url}/local", "local")
        _say(f"{rate:.0f}/s; a takeover")
        started_s = time.perf_counter()
        with serving(state / "next", f"{url}/local", "local", start_s=PATIENCE_S) as (endpoint, _):
            takeover_s = time.perf_counter() - started_s
            with ConductorClient(endpoint, None, "bench") as client:
                left = int(client.status()["left"])
                work(endpoint, left, K, "stored", f"{url}/local", names="v")
                if client.status()["left"]:
                    raise InfrastructureError("cases are left after the takeover")
        _say(f"{takeover_s:.1f} s; {few} cases whose replies wait for the store")
        durable_rate, *_ = _run(state / "durable", few, f"{url}/durable", "store")
    finally:
        shutil.rmtree(state)
    return StoreCost(
        cases=cases,
        plain_rate=plain_rate,
        rate=rate,
        durable_rate=durable_rate,
        plain_cpu_s=plain_cpu_s,
        cpu_s=cpu_s,
        plain_mb=plain_mb,
        mb=mb,
        takeover_s=takeover_s,
        left=left,
    )


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _run(state: Path, cases: int, *store: str) -> tuple[float, float, float]:
    """Commit all cases; rate [1/s], processor time [s] and memory [MB] of the conductor, which is
    killed then."""
    with serving(state, *store) as (endpoint, pid):
        with ConductorClient(endpoint, None, "bench") as client:
            client.submit(large_campaign(cases), "")
            if store:
                wall_s = work(endpoint, cases, K, "stored", store[0])
            else:
                wall_s = work(endpoint, cases, K, "full")
        process = psutil.Process(pid)
        times, memory_mb = process.cpu_times(), process.memory_info().rss / 1e6
        os.kill(pid, signal.SIGKILL)
    return cases / wall_s, times.user + times.system, memory_mb
