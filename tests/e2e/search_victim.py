"""A conductor's engine on a real journal, with workers in its own process; made to be killed.

``search_victim.py FOLDER KILLS``: a process that has all libraries loaded starts the engine again
and again, each time on what the one before has left, and kills it after some requests: that many
times, as a kernel kills. The last one runs to the end and writes the trace to
``FOLDER/trace.json``. Printed is how often each process was killed while it worked.
"""

from __future__ import annotations

import os
import random
import signal
import sys
import time
from pathlib import Path
from typing import BinaryIO

from conductor_bench import hello, next_of
from search_bench import measured, plane, section, submission, trace

from conductor.core.state import Config
from conductor.journal.store import Journal
from conductor.serve.engine import ConductorEngine, IncomingRequest
from schemas.wire.codec import decode, encode
from schemas.wire.control import Lease, Reply, Request, Submit

SEARCH = section(
    "cma_es",
    objective={"kpi": "dtc_min_m", "goal": "least"},
    chains=3,
    budget={"cases": 300, "generation": 10},
)
"""The search: each generation follows from those before of its chain."""
AHEAD = 3
"""Most requests that a process is ahead of the one that kills it."""
REQUESTS = (5, 14)
"""Fewest and most requests of a process before it is killed; the first four begin its work."""


def work(folder: Path, begun: Submit, seed: int, said: BinaryIO, allowed: BinaryIO | None) -> None:
    """Work until nothing is left, in whatever state the journal is; a byte per request, for which
    another must be there in ``allowed``."""
    numbers = random.Random(seed)
    journal = Journal(folder)
    config = Config(folder=str(folder), losses_min=1000)
    now_ns = time.monotonic_ns()
    engine = ConductorEngine(journal, config, now_ns)

    def ask(request: Request) -> Reply:
        if allowed is not None:
            allowed.read(1)
        said.write(b".")
        turn = engine.turn([IncomingRequest(encode(request), now_ns)])
        assert turn.replies[0] is not None
        reply = decode(turn.replies[0], Reply)
        assert not reply.error, reply.error
        return reply

    ask(begun)
    now_ns += config.ttl_ns + 1  # what the one before has leased is lost
    engine.tick(now_ns)
    names = [f"w{engine.state.epoch}-{index}" for index in range(3)]
    held: dict[str, list[Lease]] = {name: [] for name in names}
    for name in names:
        ask(hello(name))
    number = 0
    while engine.state.left:
        number += 1
        name = numbers.choice(names)
        numbers.shuffle(held[name])
        done, held[name] = held[name][:1], held[name][1:]
        tokens = [lease.token for lease in held[name]]
        results = [measured(lease, plane) for lease in done]
        held[name] += ask(next_of(name, number, 2, results=results, held=tokens)).leases
    (folder / "trace.json").write_bytes(trace(engine.state))
    journal.close()


def victim(folder: Path, begun: Submit, seed: int, requests: int | None) -> int:
    """A process that is killed after ``requests`` (None: never); how it ended, as its parent sees
    it."""
    ear, mouth = os.pipe()
    permits, permit = os.pipe()
    os.write(permit, bytes((requests or 0) + AHEAD))
    child = os.fork()
    if not child:
        os.close(ear)
        with (
            os.fdopen(mouth, "wb", buffering=0) as said,
            os.fdopen(permits, "rb", buffering=0) as allowed,
        ):
            work(folder, begun, seed, said, None if requests is None else allowed)
        os._exit(0)
    os.close(mouth)
    os.close(permits)
    with os.fdopen(ear, "rb", buffering=0) as heard, os.fdopen(permit, "wb", buffering=0):
        if requests is None:
            while heard.read(64):
                pass
        else:
            for _ in range(requests):
                heard.read(1)
            os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status)


def main(folder: Path, kills: int) -> None:
    """All victims, one after the other."""
    numbers = random.Random(7)
    begun = submission(SEARCH, attempts_max=100)  # by which all libraries are loaded
    killed = 0
    for seed in range(kills):
        killed += victim(folder, begun, seed, numbers.randint(*REQUESTS)) == -signal.SIGKILL
    unfinished = not (folder / "trace.json").exists()
    assert victim(folder, begun, kills, None) == 0
    print(f"{killed} killed, unfinished {unfinished}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
