"""What a search of 100,000 cases costs a conductor, beside a campaign that lists the same cases.

``PYTHONPATH=tests python tests/search_scale.py [CASES]`` prints per kind of campaign, each in a
process of its own: time, most resident memory, time and memory of a restart, and the largest
decision. Files of the run's folder are written as a conductor does it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import msgspec
from conductor_bench import hello, next_of
from search_bench import NAMES, measured, plane, section, submission

from conductor.core.state import Config
from conductor.journal.store import Journal
from conductor.serve.engine import ConductorEngine, IncomingRequest
from conductor.serve.folders import Folders
from schemas import SCHEMA_VERSION as V
from schemas.wire.codec import decode, encode
from schemas.wire.control import Lease, Reply, Request, Submit

K = 64
KINDS = ("matrix", "listed", "search")


def _matrix(cases: int) -> Submit:
    """Cases that differ in one small number."""
    matrix = {NAMES[0]: [0.5], NAMES[1]: [0.0], "weather": ["clear"], "repeat": list(range(cases))}
    return Submit(v=V, campaign={"campaign": "searched", "matrix": matrix})


def _listed(cases: int) -> Submit:
    """Cases with values of their own, in a list."""
    rows = [{NAMES[0]: 1e-5 * i, NAMES[1]: -1e-5 * i, "weather": "clear"} for i in range(cases)]
    return Submit(v=V, campaign={"campaign": "searched", "cases": rows})


def _search(cases: int) -> Submit:
    budget = {"cases": cases, "generation": 125}
    return submission(section(chains=8, budget=budget))


class Conductor:
    """Engine, journal and files of a state folder."""

    def __init__(self, path: Path) -> None:
        self.journal = Journal(path)
        self.engine = ConductorEngine(self.journal, Config(folder=str(path)), time.monotonic_ns())
        self.folders = Folders(path)
        self.slowest_s = 0.0

    def ask(self, request: Request) -> Reply:
        """One request, one commit."""
        began_s = time.perf_counter()
        (data,) = self.engine.turn([IncomingRequest(encode(request), time.monotonic_ns())]).replies
        self.slowest_s = max(self.slowest_s, time.perf_counter() - began_s)
        reply = decode(data or b"", Reply)
        assert not reply.error, reply.error
        return reply

    def close(self) -> None:
        """All files, and the end."""
        self.folders.close(self.engine.state)
        self.journal.close()


def _most_mb() -> float:
    """Most resident memory of this process so far [MB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) * 1024 / 1e6


def _run(path: Path, kind: str, cases: int) -> dict[str, Any]:
    request = {"matrix": _matrix, "listed": _listed, "search": _search}[kind](cases)
    conductor = Conductor(path)
    began_s = time.perf_counter()
    conductor.ask(request)
    del request
    conductor.ask(hello(slots=K))
    leases: list[Lease] = []
    seq = 0
    while conductor.engine.state.left:
        seq += 1
        done = [measured(lease, plane) for lease in leases]
        leases = conductor.ask(next_of("w1", seq, K, results=done)).leases
        if seq % 400 == 0:
            conductor.folders.record(conductor.engine.state.campaigns["searched"])
            conductor.folders.flush()
    ran_s = time.perf_counter() - began_s
    conductor.close()
    count = len(conductor.engine.state.campaigns["searched"].ordered)
    return {"cases": count, "ran_s": ran_s, "slowest_s": conductor.slowest_s}


def _restart(path: Path, _kind: str, cases: int) -> dict[str, Any]:
    began_s = time.perf_counter()
    conductor = Conductor(path)
    restart_s = time.perf_counter() - began_s
    campaign = conductor.engine.state.campaigns["searched"]
    assert not campaign.left
    conductor.close()
    return {"cases": len(campaign.ordered), "restart_s": restart_s}


def main(cases: int) -> None:
    """All figures."""
    for kind in KINDS:
        with tempfile.TemporaryDirectory(dir=os.environ.get("BENCH_FOLDER")) as folder:
            for step in ("_run", "_restart"):
                command = [sys.executable, __file__, step, folder, kind, str(cases)]
                done = subprocess.run(command, check=True, capture_output=True, text=True)
                print(f"{kind:8} {step.strip('_'):8} {done.stdout.strip()}", flush=True)
            names = ("conductor.db", "searched/campaign.yaml", "searched/proposed.jsonl")
            names += ("searched/search.json",)
            sizes = {
                n: (Path(folder) / n).stat().st_size for n in names if (Path(folder) / n).exists()
            }
            print(f"{kind:8} bytes    {msgspec.json.encode(sizes).decode()}", flush=True)


if __name__ == "__main__":
    if len(sys.argv) > 2:
        _, step, folder, kind, count = sys.argv
        found = {"_run": _run, "_restart": _restart}[step](Path(folder), kind, int(count))
        print({**found, "most_mb": _most_mb()})
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)
