"""A worker that simulates nothing: the protocol alone, one NEXT after the other.

It says hello, prints ``ready``, waits for a line on standard input, and then commits what it was
leased and leases as many new cases in each round trip until none is left.
"""

from __future__ import annotations

import json
import os
import sys
import time

from schemas import SCHEMA_VERSION, topics
from schemas.messages import Hello, Next, Reply, Request, Result, noop_result
from schemas.wire import decode, encode
from twin.fabric.bus import Bus
from twin.fabric.process import bind_to_parent
from twin.fabric.zenoh_bus import open_bus

TIMEOUT_S = 10.0
TRIES = 6


def drive(endpoint: str, worker: str, k: int) -> dict[str, float]:
    """Serve the bench's campaign at ``endpoint`` as ``worker``, ``k`` cases per request."""
    bus = open_bus("client", connect=[endpoint], namespace="bench")
    try:
        hello = Hello(
            v=SCHEMA_VERSION,
            worker=worker,
            host="localhost",
            pid=os.getpid(),
            device_class="cpu:bench",
            software="bench",
            slots=k,
        )
        _ask(bus, hello)
        print("ready", flush=True)
        sys.stdin.readline()
        started_s = time.perf_counter()
        cases, requests = _work(bus, worker, k)
        return {"cases": cases, "requests": requests, "wall_s": time.perf_counter() - started_s}
    finally:
        bus.close()


def _work(bus: Bus, worker: str, k: int) -> tuple[int, int]:
    cases = seq = 0
    results: list[Result] = []
    while True:
        seq += 1
        reply = _ask(bus, Next(v=SCHEMA_VERSION, worker=worker, seq=seq, k=k, results=results))
        cases += len(results)
        if reply.fenced or not reply.leases:
            return cases, seq
        results = [noop_result(lease) for lease in reply.leases]


def _ask(bus: Bus, request: Request) -> Reply:
    data = encode(request)
    for _ in range(TRIES):
        answer = bus.request(topics.RPC.key, data, TIMEOUT_S)
        if answer is not None:
            reply: Reply = decode(answer, Reply)
            if reply.error:
                sys.exit(f"refused: {reply.error}")
            return reply
    sys.exit("the conductor does not answer")


if __name__ == "__main__":
    bind_to_parent()
    print(json.dumps(drive(sys.argv[1], sys.argv[2], int(sys.argv[3]))), flush=True)
