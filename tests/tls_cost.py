"""What mutual TLS costs: lease and commit, and the drive plane, beside plain TCP in the same run.

``python tests/tls_cost.py [--cases N] [--rounds N] [--output json] [--check]``. The conductors and
the other end of the drive plane are processes of their own; journals are durable, in ``--folder``.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import multiprocessing
import shutil
import sys
import tempfile
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path

from conductor.bench.own import noop_campaign
from conductor.client import Client
from conductor.serve import serve_folder
from schemas import SCHEMA_VERSION, topics
from schemas.messages import Hello, Next, Reply, Request, Result, noop_result
from schemas.wire import decode, encode
from twin.fabric.bus import Bus
from twin.fabric.discovery import Target, await_conductor
from twin.fabric.endpoint import LOOPBACK, to_listen
from twin.fabric.key_file import load_key, make_key
from twin.fabric.software import software_digest
from twin.fabric.zenoh_bus import open_bus

SIZES = {"tick": 200, "frame": 640 * 360 * 3}
"""A small message, and a camera picture that does not travel through shared memory [bytes]."""
FLOOR = 0.5
"""--check: TLS must reach this share of plain TCP in lease and commit, and for ticks."""


def serve(folder: Path, key: Path | None) -> None:
    """A conductor, in a process of its own."""
    with contextlib.redirect_stdout(sys.stderr):
        serve_folder(folder, LOOPBACK, "twin", key=load_key(key) if key else None)


def echo(listen: str, key: Path | None, connection: Connection) -> None:
    """The other end of the drive plane: answers every message with a small one."""
    found = load_key(key) if key else None
    bus = open_bus("peer", listen=[to_listen(listen, keyed=found is not None)], key=found)
    bus.subscribe("there", lambda _: bus.publish("back", b"x" * 200, block=True))
    connection.send(bus.endpoints[0])
    connection.recv()
    bus.close()


def lease_and_commit(target: Target, k: int) -> float:
    """No-op cases per second of one worker with ``k`` per request."""
    bus = open_bus("client", connect=[target.endpoint], key=target.key)
    worker = f"bench-{k}"
    try:
        _ask(bus, Hello(SCHEMA_VERSION, worker, "h", 1, "cpu:bench", software_digest(), k))
        started_s, cases, seq = time.perf_counter(), 0, 0
        results: list[Result] = []
        while True:
            seq += 1
            reply = _ask(bus, Next(SCHEMA_VERSION, worker, seq, k, results=results))
            cases += len(results)
            if not reply.leases:
                return cases / (time.perf_counter() - started_s)
            results = [noop_result(lease) for lease in reply.leases]
    finally:
        bus.close()


def _ask(bus: Bus, request: Request) -> Reply:
    data = bus.request(topics.RPC.key, encode(request), 10.0)
    assert data is not None
    reply = decode(data, Reply)
    assert not reply.error, reply.error
    return reply


def commits(folder: Path, key: Path | None, cases: int, k: int) -> float:
    """Serve a fresh folder and measure it."""
    state = Path(tempfile.mkdtemp(prefix="tls-", dir=folder))
    process = multiprocessing.get_context("spawn").Process(target=serve, args=(state, key))
    process.start()
    try:
        target = await_conductor(state, 30.0)
        with Client("", state, "twin") as client:
            client.submit(noop_campaign(cases), "")
        return lease_and_commit(target, k)
    finally:
        process.terminate()
        process.join()
        shutil.rmtree(state)


def round_trips(key: Path | None, size: int, count: int) -> float:
    """Exchanges of ``size`` bytes there and 200 back, per second, one after the other."""
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(
        target=echo, args=(LOOPBACK, key, theirs)
    )
    process.start()
    found = load_key(key) if key else None
    bus = open_bus("peer", connect=[ours.recv()], key=found)
    try:
        back = threading.Event()
        bus.subscribe("back", lambda _: back.set())
        payload = bytes(size)
        while not back.wait(0.1):  # until both subscriptions stand
            bus.publish("there", payload, block=True)
        started_s = time.perf_counter()
        for _ in range(count):
            back.clear()
            bus.publish("there", payload, block=True)
            assert back.wait(10.0)
        return count / (time.perf_counter() - started_s)
    finally:
        bus.close()
        ours.send(None)
        process.join()


def measure(folder: Path, cases: int, rounds: int) -> dict[str, dict[str, float]]:
    """Best rates [1/s], plain and TLS interleaved, and their ratio: others use the machine too."""
    key = make_key(folder / "cost.key", replace=True).path
    rates: dict[str, dict[str, list[float]]] = {}
    for _ in range(rounds):
        for kind, used in (("plain", None), ("tls", key)):
            for k in (1, 8):
                found = commits(folder, used, cases, k)
                rates.setdefault(f"lease and commit, {k} per request", {}).setdefault(
                    kind, []
                ).append(found)
            for name, size in SIZES.items():
                found = round_trips(used, size, 1000 if size < 10_000 else 200)
                rates.setdefault(f"drive exchange, {name} of {size} bytes", {}).setdefault(
                    kind, []
                ).append(found)
    key.unlink()
    table = {}
    for name, found in rates.items():
        plain, tls = max(found["plain"]), max(found["tls"])
        table[name] = {"plain_per_s": plain, "tls_per_s": tls, "ratio": tls / plain}
    return table


def main() -> int:
    """Print the table; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=2000, help="no-op cases per run")
    parser.add_argument("--rounds", type=int, default=3, help="interleaved runs of each")
    parser.add_argument("--folder", type=Path, default=Path("runs"), help="on a real disk")
    parser.add_argument("--output", choices=("human", "json"), default="human")
    parser.add_argument("--check", action="store_true", help=f"fail below {FLOOR} of plain")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    table = measure(options.folder, options.cases, options.rounds)
    if options.output == "json":
        print(json.dumps(table))
    else:
        for name, row in table.items():
            print(
                f"{name:42} plain {row['plain_per_s']:8.0f}/s  TLS {row['tls_per_s']:8.0f}/s  "
                f"ratio {row['ratio']:.2f}"
            )
    low = [name for name, row in table.items() if row["ratio"] < FLOOR and "frame" not in name]
    return 1 if options.check and low else 0


if __name__ == "__main__":
    raise SystemExit(main())
