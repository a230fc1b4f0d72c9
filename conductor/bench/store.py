"""``conductor bench-store``: what a result store costs a conductor, and how long a takeover takes.

The same campaign of cases that simulate nothing, with results as large as a simulator's, is
committed without a store and with one, in turns. What the conductor itself has to do shows in runs
whose clients do not put their results first; a last one, whose clients do, is the rate of two lines
to the store. After that run the conductor is killed, and another with an empty folder takes over.
A smaller campaign has replies that wait for the store.
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
from statistics import median

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
CPU_RATIO_MAX = 1.25
"""--check: most processor time of a conductor with a store, as a multiple of that without [-]."""
MEMORY_RATIO_MAX = 1.2
"""--check: most memory of a conductor with a store, as a multiple of that without [-]."""
K = 256
"""Cases per request."""
DURABLE_SHARE = 20
"""Replies wait for the store in a campaign of one case in so many."""
PATIENCE_S = 300.0
"""Longest wait for a takeover, or for a submission [s]: machines may have other work."""


@dataclass(frozen=True, slots=True)
class ConductorRun:
    """One run of one conductor."""

    rate: float
    """Cases per second."""
    cpu_s: float
    """Processor time of the conductor, start and submission included [s]."""
    mb: float
    """Its memory after the last commit [MB]."""
    apart_cpu_s: float
    """Processor time of the process that speaks to the store [s]."""
    apart_mb: float
    """Its memory [MB]."""


@dataclass(frozen=True, slots=True)
class StoreCost:
    """What was measured with ``cases`` cases: medians of ``rounds`` pairs of runs."""

    cases: int
    rounds: int
    plain_rate: float
    """Cases per second without a store."""
    rate: float
    """The same with one, replies waiting for the disk."""
    rate_ratio: float
    """Median of the ratios of each pair [-]."""
    plain_cpu_s: float
    """Processor time of the conductor without a store, start and submission included [s]."""
    cpu_s: float
    """The same with one [s]."""
    plain_mb: float
    """Memory of the conductor after the last commit, without a store [MB]."""
    mb: float
    """The same with one [MB]."""
    apart_cpu_s: float
    """Processor time of the process that speaks to the store [s]; of a folder there is none."""
    apart_mb: float
    """Its memory [MB]."""
    put_rate: float
    """Cases per second of clients that put their results into the store first."""
    durable_rate: float
    """The same, replies waiting for the store."""
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
            ("mb", self.mb, MEMORY_RATIO_MAX * self.plain_mb),
        ):
            if value > most:
                lines.append(f"{name} is {value:.1f}, the target is {most:.1f}")
        return lines


def bench_store(
    cases: int, rounds: int, url: str, folder: Path, *, as_json: bool, check: bool
) -> int:
    """Measure and print; the exit code.

    Args:
        cases: cases of the campaign.
        rounds: pairs of runs, without a store and with one.
        url: result store; a prefix of its own below it is used, and stays.
        folder: where journals are written, on a real disk.
        as_json: one JSON object instead of a table.
        check: exit code 1 when a target is missed.
    """
    check_disk(folder)
    made = measure_store(cases, rounds, f"{url.rstrip('/')}/bench-{secrets.token_hex(4)}", folder)
    misses = made.misses()
    if as_json:
        print(json.dumps({**asdict(made), "misses": misses}))
    else:
        table = Table("what", "measured", title=f"a campaign of {cases} cases in {url}")
        for name, value in asdict(made).items():
            table.add_row(name, f"{value:.2f}" if isinstance(value, float) else str(value))
        Console().print(table)
    for line in misses:
        print(f"missed: {line}", file=sys.stderr)
    return EXIT_FAILED if check and misses else EXIT_PASS


def measure_store(cases: int, rounds: int, url: str, folder: Path) -> StoreCost:
    """See the module; in new state folders below ``folder``."""
    state = Path(tempfile.mkdtemp(prefix="bench-", dir=folder))
    few = max(POINTS, cases // DURABLE_SHARE // POINTS * POINTS)
    plain: list[ConductorRun] = []
    stored: list[ConductorRun] = []
    try:
        for number in range(rounds):
            for runs, store in ((plain, ()), (stored, (f"{url}/{number}", "local"))):
                runs.append(_run(state / f"{number}{len(store)}", cases, *store))
                _say(f"{cases} cases {'with' if store else 'without'} a store: {runs[-1]}")
        put = _run(state / "first", cases, f"{url}/local", "local", puts=True)
        _say(f"results put first: {put}")
        takeover_s, left = _take_over(state / "next", f"{url}/local")
        _say(f"a takeover in {takeover_s:.1f} s; {few} cases whose replies wait for the store")
        durable = _run(state / "durable", few, f"{url}/durable", "store", puts=True)
    finally:
        shutil.rmtree(state)
    return StoreCost(
        cases=cases,
        rounds=rounds,
        plain_rate=median(run.rate for run in plain),
        rate=median(run.rate for run in stored),
        rate_ratio=median(two.rate / one.rate for one, two in zip(plain, stored, strict=True)),
        plain_cpu_s=median(run.cpu_s for run in plain),
        cpu_s=median(run.cpu_s for run in stored),
        plain_mb=median(run.mb for run in plain),
        mb=median(run.mb for run in stored),
        apart_cpu_s=median(run.apart_cpu_s for run in stored),
        apart_mb=median(run.apart_mb for run in stored),
        put_rate=put.rate,
        durable_rate=durable.rate,
        takeover_s=takeover_s,
        left=left,
    )


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _take_over(folder: Path, url: str) -> tuple[float, int]:
    """Time until a successor answers [s], and how many cases it has to run again; it runs them."""
    started_s = time.perf_counter()
    with (
        serving(folder, url, "local", start_s=PATIENCE_S) as (endpoint, _),
        ConductorClient(endpoint, None, "bench") as client,
    ):
        left = _left(client, started_s + PATIENCE_S)
        takeover_s = time.perf_counter() - started_s
        if left:
            work(endpoint, left, K, "stored", url, names="v")
        if _left(client, time.perf_counter() + PATIENCE_S):
            raise InfrastructureError("cases are left after the takeover")
    return takeover_s, left


def _left(client: ConductorClient, until_s: float) -> int:
    """Cases that are left, as soon as a conductor says it that has just taken over."""
    while True:
        try:
            return int(client.status()["left"])
        except InfrastructureError:
            if time.perf_counter() > until_s:
                raise


def _run(state: Path, cases: int, *store: str, puts: bool = False) -> ConductorRun:
    """Commit all cases with a conductor that is killed then.

    ``store``: URL and what replies wait for; ``puts``: clients put their results there first.
    """
    with serving(state, *store) as (endpoint, pid):
        with ConductorClient(endpoint, None, "bench") as client:
            client.submit(large_campaign(cases), "", patience_s=PATIENCE_S)
            wall_s = (
                work(endpoint, cases, K, "stored", store[0])
                if puts
                else work(endpoint, cases, K, "full")
            )
        process = psutil.Process(pid)
        cpu_s, mb = _spent(process)
        apart = [_spent(child) for child in process.children()]
        os.kill(pid, signal.SIGKILL)
    return ConductorRun(
        cases / wall_s, cpu_s, mb, sum(cpu_s for cpu_s, _ in apart), sum(mb for _, mb in apart)
    )


def _spent(process: psutil.Process) -> tuple[float, float]:
    """Processor time [s] and memory [MB] of a process."""
    times = process.cpu_times()
    return times.user + times.system, process.memory_info().rss / 1e6
