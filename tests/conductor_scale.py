"""What a campaign of 100,000 cases costs: submit, run, status, restart, memory.

``python tests/conductor_scale.py [CASES]`` prints one line per figure.
"""

from __future__ import annotations

import gc
import sys
import tempfile
import time
from pathlib import Path

from conductor_bench import campaign, hello, next_of, result

from conductor.core.state import Config
from conductor.journal.store import Journal
from conductor.serve.engine import ConductorEngine, IncomingRequest
from schemas import SCHEMA_VERSION as V
from schemas.wire.codec import decode, encode
from schemas.wire.control import Control, Reply, Request, StatusRequest, Submit

SCALARS = {f"kpi_{i}": 1.5 * i for i in range(8)}
K = 64
WORST_S: list[float] = []


def memory_mb() -> float:
    """Resident memory of this process [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


class Timed:
    """Prints what a block took."""

    def __init__(self, what: str) -> None:
        self._what = what

    def __enter__(self) -> None:
        self._started_s = time.perf_counter()

    def __exit__(self, *_: object) -> None:
        wall_s = time.perf_counter() - self._started_s
        print(f"{self._what:34} {wall_s:8.3f} s   {memory_mb():6.0f} MB", flush=True)


def ask(engine: ConductorEngine, request: Request) -> Reply:
    """One request, one commit."""
    started_s = time.perf_counter()
    (data,) = engine.turn([IncomingRequest(encode(request), time.monotonic_ns())]).replies
    WORST_S.append(time.perf_counter() - started_s)
    reply = decode(data or b"", Reply)
    assert not reply.error, reply.error
    return reply


def run(engine: ConductorEngine, cases: int) -> None:
    """A worker does all cases."""
    leases: list[object] = []
    done = 0
    seq = 0
    while done < cases:
        seq += 1
        finished = [
            result(x, kpi=f"{x.token:064x}", scalars=SCALARS, wall_s=2.0, manifest_sha256="f" * 64)
            for x in leases
        ]
        done += len(finished)
        leases = ask(engine, next_of(worker="w1", seq=seq, k=K, results=finished)).leases


def main(cases: int) -> None:
    """All figures for a campaign of ``cases`` cases."""
    print(f"{cases} cases; at the start {memory_mb():.0f} MB")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        config = Config(folder=folder)
        journal = Journal(path)
        engine = ConductorEngine(journal, config, time.monotonic_ns())
        with Timed("submit"):
            ask(engine, Submit(v=V, campaign=campaign(cases=cases)))
        ask(engine, hello(slots=K))
        with Timed(f"lease and commit all, {K} per batch"):
            WORST_S.clear()
            run(engine, cases)
        print(f"{'  slowest turn of these':34} {max(WORST_S):8.3f} s")
        with Timed("status"):
            ask(engine, StatusRequest(v=V))
        journal.close()
        size_mb = sum(file.stat().st_size for file in path.iterdir()) / 1e6
        print(f"{'journal on disk':34} {size_mb:8.1f} MB")
        del engine
        gc.collect()
        with Timed("restart"):
            journal = Journal(path)
            engine = ConductorEngine(journal, config, time.monotonic_ns())
        assert engine.state.campaigns["alpha"].ended == {"passed": cases}
        ask(engine, Submit(v=V, campaign=campaign("beta", cases=cases)))
        with Timed("cancel"):
            ask(engine, Control(v=V, action="cancel", campaign="beta"))
        with Timed("retry"):
            ask(engine, Control(v=V, action="retry", campaign="beta"))
        journal.close()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)
