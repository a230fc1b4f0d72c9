"""``conductor bench-search``: how busy a search keeps its workers, with one chain and with several.

The conductor's decisions are the real ones. Workers and time are simulated: cases take lognormal
times, and a worker asks when a case of it has ended, or when it was told to ask again.
"""

from __future__ import annotations

import heapq
import json
import random
import sys
import time
from dataclasses import asdict, dataclass, replace
from typing import Any

import msgspec
from rich.console import Console
from rich.table import Table

from conductor.core.decisions import decide, start
from conductor.core.state import Config, State
from conductor.run.source import begun
from schemas import SCHEMA_VERSION
from schemas.plan import parse_plan
from schemas.wire.control import Hello, Lease, Next, Reply, Request, Result, Submit
from twin.base.errors import EXIT_FAILED, EXIT_PASS, UsageError

BUSY_MIN = 0.85
"""Smallest share of the time that slots are to be busy with chains."""
WORKER_SLOTS = 8
"""Most slots of one worker."""
CASE_S = 10.0
"""Median time of a case [s]."""
NAME = "bench-search"
_SESSION = bytes(32)
_PARAMETERS = ("objects.a.start_s", "objects.a.offset_m")


@dataclass(frozen=True, slots=True)
class SearchLoad:
    """A search, and what runs it."""

    chains: int
    generation: int
    cases: int
    slots: int
    spread: float
    """Standard deviation of the logarithm of a case's time."""
    sampler: str
    seed: int = 1


@dataclass(frozen=True, slots=True)
class MeasuredSearch:
    """What came of a search."""

    chains: int
    cases: int
    generations: int
    busy: float
    """Share of all slots' time in which they ran a case."""
    turn_ms: float
    """The conductor's own time for a case, proposals included [ms]."""
    slowest_ms: float
    """Its longest decision [ms]."""


def bench_search(load: SearchLoad, *, as_json: bool, check: bool) -> int:
    """Measure one chain and then all of ``load``, and print; the exit code.

    Raises:
        UsageError: there is no such search.
    """
    runs = [measure_search(replace(load, chains=chains)) for chains in {1, load.chains}]
    runs.sort(key=lambda run: run.chains)
    if as_json:
        print(json.dumps({"load": asdict(load), "runs": [asdict(run) for run in runs]}))
    else:
        Console().print(_table(load, runs))
    if runs[-1].busy >= BUSY_MIN:
        return EXIT_PASS
    said = f"{runs[-1].busy:.1%} busy with {load.chains} chains, the target is {BUSY_MIN:.0%}"
    print(f"missed: {said}", file=sys.stderr)
    return EXIT_FAILED if check else EXIT_PASS


def measure_search(load: SearchLoad) -> MeasuredSearch:
    """One search, from its submission to its end.

    Raises:
        UsageError: there is no such search.
    """
    core = _Core()
    core.ask(Submit(v=SCHEMA_VERSION, campaign=_content(load)), 0.0)
    busy_s, end_s = _work(core, load)
    campaign = core.state.campaigns[NAME]
    assert campaign.search is not None
    cases = len(campaign.ordered)
    return MeasuredSearch(
        chains=load.chains,
        cases=cases,
        generations=len(campaign.search.results),
        busy=busy_s / (load.slots * end_s),
        turn_ms=core.took_s / cases * 1e3,
        slowest_ms=core.slowest_s * 1e3,
    )


class _Core:
    """A conductor without journal and network, and how long it took."""

    def __init__(self) -> None:
        self.state = State(config=Config(folder="/bench", speculate=False))
        start(self.state)
        self.took_s = self.slowest_s = 0.0

    def ask(self, request: Request, now_s: float) -> Reply:
        """The answer to a request at a simulated time."""
        began_s = time.perf_counter()
        _, reply = decide(self.state, request, round((now_s + 1.0) * 1e9))
        took_s = time.perf_counter() - began_s
        self.took_s += took_s
        self.slowest_s = max(self.slowest_s, took_s)
        if reply.error:
            raise UsageError(reply.error)
        return reply


@dataclass(slots=True)
class _Worker:
    """A simulated worker."""

    name: str
    slots: int
    held: dict[int, tuple[float, Lease]]
    """Token -> when it ends [s], lease."""
    seq: int = 0


def _work(core: _Core, load: SearchLoad) -> tuple[float, float]:
    """All cases; slots' time that was spent on them, and when the last had ended [s]."""
    numbers = random.Random(load.seed)
    counts = [WORKER_SLOTS] * (load.slots // WORKER_SLOTS)
    counts += [load.slots % WORKER_SLOTS] if load.slots % WORKER_SLOTS else []
    workers = [_Worker(f"w{place}", slots, {}) for place, slots in enumerate(counts)]
    clock = [(0.0, place) for place in range(len(workers))]
    for worker in workers:
        core.ask(_hello(worker), 0.0)
    busy_s = now_s = 0.0
    while core.state.left:
        now_s, place = heapq.heappop(clock)
        worker = workers[place]
        done = [token for token, (end_s, _) in worker.held.items() if end_s <= now_s]
        results = [_result(worker.held.pop(token)[1]) for token in done]
        worker.seq += 1
        reply = core.ask(
            Next(
                v=SCHEMA_VERSION,
                worker=worker.name,
                seq=worker.seq,
                k=worker.slots - len(worker.held),
                results=results,
                held=list(worker.held),
                session=_SESSION,
            ),
            now_s,
        )
        for lease in reply.leases:
            took_s = CASE_S * numbers.lognormvariate(0.0, load.spread)
            busy_s += took_s
            worker.held[lease.token] = (now_s + took_s, lease)
        wakes = [end_s for end_s, _ in worker.held.values()]
        if len(worker.held) < worker.slots:
            wakes.append(now_s + reply.retry_after_s)
        heapq.heappush(clock, (min(wakes), place))
    return busy_s, now_s


def _content(load: SearchLoad) -> dict[str, Any]:
    """The campaign of a search, with its first generations."""
    normal = {"distribution": "normal", "mean": 0.0, "sd": 1.0}
    search = {
        "parameters": dict.fromkeys(_PARAMETERS, normal),
        "objective": {"kpi": "dtc_min_m", "fails_below": 0.0},
        "budget": {"cases": load.cases, "generation": load.generation},
        "sampler": load.sampler,
        "chains": load.chains,
    }
    plan, mistakes = parse_plan(
        {"campaign": NAME, "matrix": {"weather": ["clear"]}, "search": search}
    )
    if plan is None:
        raise UsageError(mistakes[0].line(NAME))
    content: dict[str, Any] = msgspec.to_builtins(begun(plan).campaign)
    return content


def _hello(worker: _Worker) -> Hello:
    return Hello(
        v=SCHEMA_VERSION,
        worker=worker.name,
        host="bench",
        pid=1,
        device_class="cpu",
        software="bench",
        slots=worker.slots,
        session=_SESSION,
    )


def _result(lease: Lease) -> Result:
    """A verdict; the KPI is the distance from a plane that one case in fifteen is beyond."""
    varied = lease.case.variation.objects["a"]
    assert varied.start_s is not None
    return Result(
        campaign=NAME,
        case=lease.case.id,
        token=lease.token,
        outcome="verdict",
        verdict="pass",
        attempt_dir=lease.attempt_dir,
        kpi_sha256="0" * 64,
        scalars={"dtc_min_m": 1.5 - (varied.start_s + varied.offset_m) / 2**0.5},
    )


def _table(load: SearchLoad, runs: list[MeasuredSearch]) -> Table:
    title = (
        f"{load.sampler}, generations of {load.generation}, {load.slots} slots, "
        f"lognormal times, sigma {load.spread:g}"
    )
    table = Table("chains", "slots busy", "cases", "generations", title=title)
    table.add_column("conductor, ms per case", justify="right")
    table.add_column("longest decision, ms", justify="right")
    for run in runs:
        table.add_row(
            str(run.chains),
            f"{run.busy:.1%}",
            str(run.cases),
            str(run.generations),
            f"{run.turn_ms:.2f}",
            f"{run.slowest_ms:.0f}",
        )
    return table
