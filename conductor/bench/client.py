"""A worker that simulates nothing: the protocol alone, one NEXT after the other.

It says hello, prints ``ready``, waits for a line on standard input, and then commits what it was
leased and leases as many new cases in each round trip until none is left. ``files``: it writes the
files of every attempt first, as a simulator does. ``stored``: it puts its results into a store
first.
"""

from __future__ import annotations

import twin.base.start  # noqa: F401 - as every command of ours begins

# isort: split
import hashlib
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from schemas import SCHEMA_VERSION
from schemas.files.judging import RECORD_FILE, attempt_digest
from schemas.files.kpi import SCALARS
from schemas.wire.codec import decode, encode
from schemas.wire.control import Hello, Lease, Next, Reply, Request, Result, noop_result
from schemas.wire.rpc_routes import route_key
from twin.base.files import write_atomic
from twin.base.process import bind_to_parent
from twin.fabric.bus import Bus
from twin.fabric.session import new_secret, seal
from twin.fabric.zenoh_bus import open_bus
from twin.records.kpi_file import kpi_sha256, kpi_table, write_kpi
from twin.stores.putting import Storing

TIMEOUT_S = 10.0
TRIES = 6
LOG = b"a made-up attempt\n"

Made = Callable[[Lease], Result]
"""Result that is committed of a lease."""


def drive(endpoint: str, worker: str, k: int, made: Made, store: str = "") -> dict[str, float]:
    """Serve the bench's campaign at ``endpoint`` as ``worker``, ``k`` cases per request.

    ``made``: its results; ``store``: where they are put before they are committed.
    """
    session = new_secret()
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
            session=session,
        )
        _ask(bus, hello)
        print("ready", flush=True)
        sys.stdin.readline()
        started_s = time.perf_counter()
        storing = Storing(seal)
        storing.join(store)
        cases, requests = _work(bus, worker, session, k, made, storing)
        return {"cases": cases, "requests": requests, "wall_s": time.perf_counter() - started_s}
    finally:
        bus.close()


def _work(
    bus: Bus, worker: str, session: bytes, k: int, made: Made, storing: Storing
) -> tuple[int, int]:
    cases = seq = 0
    results: list[Result] = []
    while True:
        seq += 1
        request = Next(
            v=SCHEMA_VERSION, worker=worker, seq=seq, k=k, results=results, session=session
        )
        storing.put(request, lambda: None)
        reply = _ask(bus, request)
        cases += len(results)
        if reply.fenced or not reply.leases:
            return cases, seq
        results = [made(lease) for lease in reply.leases]


def full_result(lease: Lease) -> Result:
    """Result as large as a simulator's, and different for every case."""
    sha = hashlib.sha256(lease.case.id.encode()).digest()
    return msgspec.structs.replace(
        noop_result(lease),
        scalars={column.name: sha[n] / 3.0 for n, column in enumerate(SCALARS)},
        reasons=[f"no collision: stopped {sha[0] / 7.0:.2f} m before the obstacle"],
        attempt_dir=lease.attempt_dir,
        kpi_sha256=sha.hex(),
        manifest_sha256=hashlib.sha256(sha).hexdigest(),
        wall_s=sha[0] / 10.0,
    )


def with_files(template: dict[str, Any]) -> Made:
    """Results with KPI file, judge's record and log in their attempt folders.

    ``template``: what ``twin.bench.attempt`` prints.
    """

    def made(lease: Lease) -> Result:
        relative = lease.attempt_dir
        folder = Path(lease.out) / relative
        table = kpi_table(template["columns"])
        scenario = msgspec.to_builtins(lease.case.variation.scenario)
        record = {**template["record"], "case": lease.case.id, "scenario": scenario}
        encoded = msgspec.json.encode(record) + b"\n"
        folder.mkdir(parents=True, exist_ok=True)
        write_kpi(table, folder / "kpi.parquet")
        write_atomic(folder / RECORD_FILE, encoded)
        write_atomic(folder / "log.txt", LOG)
        sha = kpi_sha256(table)
        return msgspec.structs.replace(
            noop_result(lease),
            **template["result"],
            attempt_dir=relative,
            kpi_sha256=sha,
            manifest_sha256=attempt_digest(sha, LOG, encoded),
        )

    return made


def _ask(bus: Bus, request: Request) -> Reply:
    data = encode(request)
    for _ in range(TRIES):
        answer = bus.request(route_key(request), data, TIMEOUT_S)
        if answer is not None:
            reply: Reply = decode(answer, Reply)
            if reply.error:
                sys.exit(f"refused: {reply.error}")
            return reply
    sys.exit("the conductor does not answer")


if __name__ == "__main__":
    bind_to_parent()
    endpoint, worker, k, kind, *file = sys.argv[1:]
    results: dict[str, Made] = {"noop": noop_result, "full": full_result}
    if kind == "files":
        results["files"] = with_files(msgspec.json.decode(Path(file[0]).read_bytes()))
    if kind == "stored":
        results["stored"] = full_result
    store = file[0] if kind == "stored" else ""
    print(json.dumps(drive(endpoint, worker, int(k), results[kind], store)), flush=True)
