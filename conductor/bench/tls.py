"""``conductor bench-tls``: what mutual TLS and access lists cost, beside plain TCP in the same run.

Lease and commit of no-op cases, and exchanges on a drive plane: a small message, a picture as
payload, and a picture in memory that both sides share. The conductors and the other end of the
drive plane are processes of their own; journals are durable, in ``folder``. What goes over the wire
is counted by the kernel.
"""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import shutil
import signal
import socket
import struct
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import psutil

from conductor.bench.front import FrontRow, measure_front
from conductor.bench.own import noop_campaign
from conductor.commands.client import ConductorClient
from conductor.core.state import Config
from conductor.serve.command import serve_folder
from conductor.serve.shell import Conductor
from schemas import SCHEMA_VERSION
from schemas.wire import topics
from schemas.wire.codec import decode, encode
from schemas.wire.control import Hello, Next, Reply, Request, Result, noop_result
from schemas.wire.rpc_routes import route_key
from twin.base.errors import EXIT_FAILED, EXIT_PASS, InfrastructureError, storage_error
from twin.base.software import software_digest
from twin.fabric.bus import Bus
from twin.fabric.discovery import Target, await_conductor
from twin.fabric.endpoint import LOOPBACK, to_listen
from twin.fabric.frames import FrameBuffer, FrameChannel, open_frames
from twin.fabric.keys.authority import make_keys
from twin.fabric.keys.key_file import MemberKey, load_key
from twin.fabric.keys.rig_keys import RigKeys
from twin.fabric.keys.roles import Role
from twin.fabric.rig_folder import RigFolder, frames_socket
from twin.fabric.session import new_secret
from twin.fabric.zenoh_bus import open_bus

FLOOR = 0.5
"""--check: TLS must reach this share of plain TCP in lease and commit, and for ticks."""
WIRE_BYTES_MAX = 2000
"""--check: an exchange whose picture lies in shared memory may send so much [bytes]."""
TICK_BYTES, FRAME = 200, FrameChannel("camera", (1, 360, 640, 3), "|u1")
FRAME_BYTES = 640 * 360 * 3
NAMESPACE = "bench/rig"
WAIT_S = 10.0


@dataclass(frozen=True, slots=True)
class Exchange:
    """One kind of exchange on the drive plane."""

    name: str
    payload_bytes: int
    shared: bool = False
    """The picture is written into memory that both sides map."""
    rounds: int = 1000


EXCHANGES = (
    Exchange("tick", TICK_BYTES),
    Exchange("picture as payload", FRAME_BYTES, rounds=200),
    Exchange("picture in shared memory", TICK_BYTES, shared=True, rounds=200),
)


@dataclass(frozen=True, slots=True)
class BenchRow:
    """One line of the table: the best of all rounds, because others use the machine too."""

    plain_per_s: float
    tls_per_s: float
    wire_bytes: float | None = None
    """What an exchange sends with TLS; None: not counted [bytes]."""

    @property
    def ratio(self) -> float:
        """Rate of TLS to the rate of plain TCP."""
        return self.tls_per_s / self.plain_per_s


def bench_tls(cases: int, rounds: int, folder: Path, *, as_json: bool, check: bool) -> int:
    """Measure and print; the exit code."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix="bench-tls-", dir=folder))
    except OSError as error:
        raise storage_error(error, str(folder)) from None
    try:
        table = _measure(scratch, cases, rounds)
        behind = measure_front(scratch / "keys", rounds)
        for k in (1, 8):
            behind[f"lease and commit, {k} per request"] = _behind_front(scratch, cases, rounds, k)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    missed = _missed(table)
    if as_json:
        rows = {name: {**asdict(row), "ratio": row.ratio} for name, row in table.items()}
        front = {name: {**asdict(row), "ratio": row.ratio} for name, row in behind.items()}
        print(json.dumps({"rows": rows, "front": front, "misses": missed}))
    else:
        for name, row in table.items():
            wire = "" if row.wire_bytes is None else f"  {row.wire_bytes:8.0f} bytes sent"
            print(
                f"{name:36} plain {row.plain_per_s:7.0f}/s  TLS {row.tls_per_s:7.0f}/s  "
                f"ratio {row.ratio:.2f}{wire}"
            )
        for name, behind_row in behind.items():
            print(
                f"{name:36} TLS {behind_row.direct:9.0f} {behind_row.unit:5}  "
                f"behind the front {behind_row.front:7.0f} {behind_row.unit:5}  "
                f"ratio {behind_row.ratio:.2f}"
            )
    for line in missed:
        print(f"missed: {line}", file=sys.stderr)
    return EXIT_FAILED if check and missed else EXIT_PASS


def _missed(table: dict[str, BenchRow]) -> list[str]:
    low = [
        f"{name}: {row.ratio:.2f} of plain TCP, at least {FLOOR}"
        for name, row in table.items()
        if "payload" not in name and row.ratio < FLOOR
    ]
    large = [
        f"{name}: {row.wire_bytes:.0f} bytes sent, at most {WIRE_BYTES_MAX}"
        for name, row in table.items()
        if "shared" in name and row.wire_bytes is not None and row.wire_bytes > WIRE_BYTES_MAX
    ]
    return low + large


def _measure(folder: Path, cases: int, rounds: int) -> dict[str, BenchRow]:
    keys = make_keys(folder / "keys")
    rates: dict[str, dict[bool, list[float]]] = {}
    wire: dict[str, float] = {}
    for _ in range(rounds):
        for tls, used in ((False, None), (True, keys)):  # in turns
            for k in (1, 8):
                name = f"lease and commit, {k} per request"
                commits_per_s = _commits(folder, used, cases, k)
                rates.setdefault(name, {}).setdefault(tls, []).append(commits_per_s)
            for exchange in EXCHANGES:
                rate, sent = _round_trips(exchange, tls=tls)
                rates.setdefault(exchange.name, {}).setdefault(tls, []).append(rate)
                wire[exchange.name] = sent
    return {
        name: BenchRow(max(by_tls[False]), max(by_tls[True]), wire.get(name))
        for name, by_tls in rates.items()
    }


def _behind_front(folder: Path, cases: int, rounds: int, k: int) -> FrontRow:
    rates: dict[bool, list[float]] = {False: [], True: []}
    for _ in range(rounds):
        for front in (False, True):  # in turns
            rates[front].append(_commits(folder, folder / "keys", cases, k, front=front))
    return FrontRow(max(rates[False]), max(rates[True]), "/s")


def _serve(folder: Path, keys: Path | None, front: bool) -> None:
    """A conductor, in a process of its own."""
    with contextlib.redirect_stdout(sys.stderr):
        key = load_key(keys, Role.conductor) if keys else None
        if front or key is None:
            serve_folder(folder, LOOPBACK, "twin", key=key)
            return
        conductor = Conductor(folder, key=key, config=Config(spread=True), bus_factory=_direct)
        signal.signal(signal.SIGTERM, lambda *_: conductor.stop())
        conductor.serve()


def _direct(listen: Sequence[str], namespace: str, key: MemberKey | None) -> Bus:
    """A router whose listener everybody reaches."""
    return open_bus("router", listen=listen, namespace=namespace, key=key)


def _commits(folder: Path, keys: Path | None, cases: int, k: int, *, front: bool = False) -> float:
    """No-op cases per second through a conductor on a fresh folder."""
    state = Path(tempfile.mkdtemp(prefix="state-", dir=folder))
    process = multiprocessing.get_context("spawn").Process(target=_serve, args=(state, keys, front))
    try:
        process.start()
        target = await_conductor(state, 30.0, Role.worker)
        with ConductorClient("", state, "twin", role=Role.submitter) as client:
            client.submit(noop_campaign(cases), "")
        return _lease_and_commit(target, k)
    finally:
        if process.pid is not None:
            process.terminate()
            process.join()


def _lease_and_commit(target: Target, k: int) -> float:
    """No-op cases per second of one worker with ``k`` per request."""
    bus = open_bus("client", connect=[target.endpoint], key=target.key)
    worker, session = f"bench-{k}", new_secret()
    hello = Hello(
        *(SCHEMA_VERSION, worker, "h", 1, "cpu:bench", software_digest(), k), session=session
    )
    try:
        _ask(bus, hello)
        started_s, cases, seq = time.perf_counter(), 0, 0
        results: list[Result] = []
        while True:
            seq += 1
            request = Next(SCHEMA_VERSION, worker, seq, k, results=results, session=session)
            reply = _ask(bus, request)
            cases += len(results)
            if not reply.leases:
                return cases / (time.perf_counter() - started_s)
            results = [noop_result(lease) for lease in reply.leases]
    finally:
        bus.close()


def _ask(bus: Bus, request: Request) -> Reply:
    data = bus.request(route_key(request), encode(request), WAIT_S)
    if data is None:
        raise InfrastructureError("the bench's conductor does not answer")
    reply: Reply = decode(data, Reply)
    if reply.error:
        raise InfrastructureError(f"the bench's conductor: {reply.error}")
    return reply


_TICK = topics.TICK.key.format(rig="rig")
_COMMAND = topics.COMMAND.key.format(rig="rig")


def _stack(key_path: Path | None, path: str, nonce: str, connection: Connection) -> None:
    """The other end of the drive plane, in a process of its own: answers with a small message."""
    key = load_key(key_path, Role.stack) if key_path else None
    shared = open_frames(path, FRAME_BYTES, nonce) if path else None
    bus = open_bus("peer", connect=[connection.recv()], key=key, namespace=NAMESPACE)

    def answer(_: object) -> None:
        if shared is not None:
            shared.seek(0)
            shared.read()  # as whoever looks at the picture does
        bus.publish(_COMMAND, b"x" * TICK_BYTES, block=True)

    bus.subscribe(_TICK, answer)
    connection.recv()
    bus.close()


def _round_trips(exchange: Exchange, *, tls: bool) -> tuple[float, float]:
    """Exchanges per second, one after the other, and bytes that one of them sends."""
    keys = RigKeys("bench") if tls else None
    ours, theirs = multiprocessing.Pipe()
    folder = RigFolder()
    frames = FrameBuffer(FRAME_BYTES, frames_socket(folder.drive)) if exchange.shared else None
    place = (frames.path, frames.nonce) if frames else ("", "")
    process = multiprocessing.get_context("spawn").Process(
        target=_stack, args=(keys and keys.stack, *place, theirs)
    )
    process.start()
    key = load_key(keys.simulator, Role.worker) if keys else None
    listen = [to_listen(LOOPBACK, keyed=tls)]
    bus = open_bus("peer", listen=listen, key=key, namespace=NAMESPACE)
    try:
        ours.send(bus.endpoints[0])
        back = threading.Event()
        bus.subscribe(_COMMAND, lambda _: back.set())
        payload = bytes(exchange.payload_bytes)
        view = frames.array(FRAME, 0).reshape(-1) if frames else None
        while not back.wait(0.1):  # until both subscriptions stand
            bus.publish(_TICK, payload, block=True)
        sent, started_s = _sent_bytes(), time.perf_counter()
        for number in range(exchange.rounds):
            if view is not None:
                view[:] = number % 256
            back.clear()
            bus.publish(_TICK, payload, block=True)
            if not back.wait(WAIT_S):
                raise InfrastructureError("the bench's stack does not answer")
        took_s = time.perf_counter() - started_s
        return exchange.rounds / took_s, (_sent_bytes() - sent) / exchange.rounds
    finally:
        bus.close()
        ours.send(None)
        process.join()
        if frames:
            frames.close()
        folder.close()
        if keys:
            keys.close()


def _sent_bytes() -> int:
    """What the TCP connections of this process have sent so far, as the kernel counts [bytes]."""
    total = 0
    for entry in psutil.Process().net_connections("tcp"):
        if entry.status != psutil.CONN_ESTABLISHED:
            continue
        with socket.socket(fileno=os.dup(entry.fd)) as connection:
            info = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 256)
        total += struct.unpack_from("=Q", info, _BYTES_ACKED)[0]
    return total


_BYTES_ACKED = 120
"""Where ``tcpi_bytes_acked`` stands in Linux's ``struct tcp_info``."""
