"""A conductor's engine on a real journal, with workers in its own process; made to be killed.

``search_victim.py FOLDER SEED``: runs the search of the test to its end, in whatever state the
journal is, and writes the trace to ``FOLDER/trace.json``. A line on standard output per request.
"""

from __future__ import annotations

import random
import sys
import time
from pathlib import Path

from conductor_bench import hello, next_of
from search_bench import measured, plane, section, submission, trace

from conductor.core.state import Config
from conductor.journal.store import Journal
from conductor.serve.engine import ConductorEngine, IncomingRequest
from schemas.wire.codec import decode, encode
from schemas.wire.control import Lease, Reply, Request

SEARCH = section(
    "cma_es", objective={"kpi": "dtc_min_m", "goal": "least"}, budget={"cases": 60, "generation": 6}
)
"""The search: each generation follows from the one before."""


def main(folder: Path, seed: int) -> None:
    """Work until nothing is left."""
    numbers = random.Random(seed)
    journal = Journal(folder)
    config = Config(folder=str(folder), losses_min=1000)
    now_ns = time.monotonic_ns()
    engine = ConductorEngine(journal, config, now_ns)

    def ask(request: Request) -> Reply:
        print("asked", flush=True)
        turn = engine.turn([IncomingRequest(encode(request), now_ns)])
        assert turn.replies[0] is not None
        reply = decode(turn.replies[0], Reply)
        assert not reply.error, reply.error
        return reply

    ask(submission(SEARCH, attempts_max=100))
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
        held[name] += ask(next_of(name, number, 1, results=results, held=tokens)).leases
    (folder / "trace.json").write_bytes(trace(engine.state))
    journal.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
