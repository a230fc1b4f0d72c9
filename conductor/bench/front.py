"""What the front before a conductor's router costs: rows of ``conductor bench-tls``.

The same exchanges through a router that members reach directly, and through one behind a front:
requests one after the other, pictures of a rig to a viewer, and files of attempts. Members are
processes of their own.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from schemas.wire import topics
from twin.base.errors import InfrastructureError
from twin.fabric.bus import Bus
from twin.fabric.endpoint import LOOPBACK, to_listen
from twin.fabric.front.router import Fronted
from twin.fabric.keys.key_file import load_key
from twin.fabric.keys.roles import Role
from twin.fabric.zenoh_bus import open_bus

WAIT_S = 10.0
MIB = 1 << 20
_VIEW = topics.VIEW_LIVE_CAMERA.key.format(campaign="bench", case="case", sensor="camera")


@dataclass(frozen=True, slots=True)
class FrontRow:
    """One exchange, the best of all rounds."""

    direct: float
    front: float
    unit: str

    @property
    def ratio(self) -> float:
        """Rate with the front to the rate without."""
        return self.front / self.direct


@dataclass(frozen=True, slots=True)
class _Kind:
    name: str
    unit: str
    measure: Callable[[Bus, str, Path], float]


def measure_front(keys: Path, rounds: int) -> dict[str, FrontRow]:
    """The table, by name."""
    rates: dict[str, dict[bool, list[float]]] = {kind.name: {} for kind in _KINDS}
    for _ in range(rounds):
        for fronted in (False, True):  # in turns
            with _router(keys, fronted=fronted) as (bus, endpoint):
                for kind in _KINDS:
                    rate = kind.measure(bus, endpoint, keys)
                    rates[kind.name].setdefault(fronted, []).append(rate)
    return {
        kind.name: FrontRow(max(rates[kind.name][False]), max(rates[kind.name][True]), kind.unit)
        for kind in _KINDS
    }


@contextlib.contextmanager
def _router(keys: Path, *, fronted: bool) -> Iterator[tuple[Bus, str]]:
    key, listen = load_key(keys, Role.conductor), to_listen(LOOPBACK, keyed=True)
    if fronted:
        front = Fronted(listen, "twin", key, lambda _: None)
        try:
            yield front.bus, front.bus.endpoints[0]
        finally:
            front.close()
        return
    bus = open_bus("router", listen=[listen], key=key)
    try:
        yield bus, bus.endpoints[0]
    finally:
        bus.close()


def _requests(size: int, count: int) -> Callable[[Bus, str, Path], float]:
    """A member asks ``count`` times with ``size`` bytes, one after the other; requests per s."""

    def measure(bus: Bus, endpoint: str, keys: Path) -> float:
        key = (topics.RPC_STATUS if size < 4096 else topics.FILES).key
        cancel = bus.serve(key, lambda _, respond: respond(b"x" * 200))
        try:
            return _of_member(_ask, endpoint, keys, key, size, count)
        finally:
            cancel()

    return measure


def _ask(pipe: Connection, endpoint: str, keys: Path, key: str, size: int, count: int) -> None:
    bus = open_bus("client", connect=[endpoint], key=load_key(keys, Role.worker))
    payload = bytes(size)
    while bus.request(key, b"", 1.0) is None:
        pass
    started_s = time.perf_counter()
    for _ in range(count):
        if bus.request(key, payload, WAIT_S) is None:
            raise InfrastructureError("the bench's router does not answer")
    pipe.send(count / (time.perf_counter() - started_s))
    bus.close()


def _pictures(size: int, count: int) -> Callable[[Bus, str, Path], float]:
    """A rig publishes pictures of ``size`` bytes, a viewer takes them; MiB that arrive per s."""

    def measure(_bus: Bus, endpoint: str, keys: Path) -> float:
        rig = open_bus("client", connect=[endpoint], key=load_key(keys, Role.worker))
        over, payload = threading.Event(), bytes(size)

        def publish() -> None:
            while not over.is_set():
                if rig.wanted(_VIEW):
                    rig.publish(_VIEW, payload, block=True)
                else:
                    time.sleep(0.01)

        thread = threading.Thread(target=publish, daemon=True)
        thread.start()
        try:
            return _of_member(_look, endpoint, keys, size, count)
        finally:
            over.set()
            thread.join()
            rig.close()

    return measure


def _look(pipe: Connection, endpoint: str, keys: Path, size: int, count: int) -> None:
    bus = open_bus("client", connect=[endpoint], key=load_key(keys, Role.viewer))
    times: list[float] = []
    over = threading.Event()

    def take(_: object) -> None:
        times.append(time.perf_counter())
        if len(times) == count:
            over.set()

    bus.subscribe(_VIEW, take)
    if not over.wait(6 * WAIT_S):
        raise InfrastructureError("the bench's pictures do not arrive")
    pipe.send((count - 1) * size / MIB / (times[count - 1] - times[0]))
    bus.close()


def _of_member(work: Callable[..., None], *arguments: object) -> float:
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=work, args=(theirs, *arguments))
    process.start()
    try:
        if not ours.poll(12 * WAIT_S):
            raise InfrastructureError("the bench's member does not come to an end")
        return float(ours.recv())
    finally:
        process.terminate()
        process.join()


_KINDS = (
    _Kind("small request and reply", "/s", _requests(200, 1000)),
    _Kind("files of an attempt, 1 MiB each", "/s", _requests(MIB, 60)),
    _Kind("pictures to a viewer, 20 kB each", "MiB/s", _pictures(20_000, 2_000)),
    _Kind("pictures to a viewer, 691 kB each", "MiB/s", _pictures(640 * 360 * 3, 150)),
)
