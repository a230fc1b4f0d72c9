"""The bus in memory, with injectable loss, delay and duplication from a seed.

A :class:`MemoryHub` plays the network: sessions opened on it hear each other. Messages wait in a
queue until :meth:`MemoryHub.deliver`, so a test decides when and in which order anything arrives; a
pump thread (``MemoryHub.run``) delivers for tests that use real threads.
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from twin.fabric.bus import Cancel, Respond, Sample


@dataclass(slots=True)
class Faults:
    """Probabilities per message; a delayed message is overtaken by later ones."""

    loss: float = 0.0
    duplicate: float = 0.0
    delay: float = 0.0


@dataclass(slots=True)
class _Waiting:
    deliver: Callable[[], None]
    due: int
    """Position in the delivery order."""


@dataclass(slots=True)
class HubCounters:
    """Counts of what the hub did; a test that drove no fault proves nothing."""

    delivered: int = 0
    lost: int = 0
    duplicated: int = 0
    delayed: int = 0


@dataclass(slots=True)
class MemoryHub:
    """The network between in-memory sessions."""

    seed: int = 0
    faults: Faults = field(default_factory=Faults)
    counters: HubCounters = field(default_factory=HubCounters)
    _random: random.Random = field(init=False)
    _condition: threading.Condition = field(default_factory=threading.Condition)
    _waiting: list[_Waiting] = field(default_factory=list)
    _order: int = 0
    _buses: list[MemoryBus] = field(default_factory=list)
    _tokens: dict[str, MemoryBus] = field(default_factory=dict)
    _stopped: bool = False

    def __post_init__(self) -> None:
        self._random = random.Random(self.seed)

    def open(self) -> MemoryBus:
        """A new session on this hub."""
        bus = MemoryBus(self)
        with self._condition:
            self._buses.append(bus)
        return bus

    def post(self, deliver: Callable[[], None]) -> None:
        """Put one message on the network."""
        with self._condition:
            copies = 1
            if self._random.random() < self.faults.loss:
                self.counters.lost += 1
                copies = 0
            elif self._random.random() < self.faults.duplicate:
                self.counters.duplicated += 1
                copies = 2
            for _ in range(copies):
                self._order += 1
                due = self._order
                if self._random.random() < self.faults.delay:
                    self.counters.delayed += 1
                    due += self._random.randint(1, 8)
                self._waiting.append(_Waiting(deliver, due))
            self._waiting.sort(key=lambda w: w.due)
            self._condition.notify_all()

    def deliver(self, count: int = 1_000_000) -> int:
        """Deliver up to ``count`` waiting messages, including those caused by them."""
        done = 0
        while done < count:
            with self._condition:
                if not self._waiting:
                    break
                waiting = self._waiting.pop(0)
                self._order = max(self._order, waiting.due)
                self.counters.delivered += 1
            waiting.deliver()
            done += 1
        return done

    def run(self) -> threading.Thread:
        """Deliver on a thread of its own until :meth:`stop`."""
        thread = threading.Thread(target=self._pump, name="memory-hub", daemon=True)
        thread.start()
        return thread

    def stop(self) -> None:
        """End the pump."""
        with self._condition:
            self._stopped = True
            self._condition.notify_all()

    def _pump(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._stopped or self._waiting)
                if self._stopped:
                    return
            self.deliver()

    def sessions(self) -> list[MemoryBus]:
        """Sessions that are open."""
        with self._condition:
            return [bus for bus in self._buses if not bus.closed]

    def token(self, key: str, bus: MemoryBus | None) -> None:
        """A liveliness token appears (``bus``) or goes (None)."""
        with self._condition:
            if bus is None:
                self._tokens.pop(key, None)
            else:
                self._tokens[key] = bus
        for session in self.sessions():
            session.hear_token(key, bus is not None)

    def tokens(self) -> dict[str, MemoryBus]:
        """Live tokens."""
        with self._condition:
            return dict(self._tokens)


class MemoryBus:
    """A session on a :class:`MemoryHub`; same interface as the Zenoh one."""

    def __init__(self, hub: MemoryHub) -> None:
        self.endpoints: list[str] = []
        self.closed = False
        self._hub = hub
        self._subscribers: list[tuple[str, Callable[[Sample], None]]] = []
        self._services: list[tuple[str, Callable[[bytes, Respond], None]]] = []
        self._watchers: list[tuple[str, Callable[[str, bool], None]]] = []

    def publish(
        self,
        key: str,
        payload: bytes,
        attachment: bytes = b"",
        *,
        block: bool = False,  # noqa: ARG002 - the hub decides what is lost
    ) -> None:
        """See :class:`twin.fabric.bus.Bus`."""
        if self.closed:
            return
        sample = Sample(key, bytes(payload), bytes(attachment))
        for bus in self._hub.sessions():
            for pattern, handler in list(bus._subscribers):
                if matches(pattern, key):
                    self._hub.post(_guarded(bus, handler, sample))

    def wanted(self, key: str) -> bool:
        """See :class:`twin.fabric.bus.Bus`."""
        return any(
            intersects(pattern, key)
            for bus in self._hub.sessions()
            for pattern, _ in bus._subscribers
        )

    def release(self, key: str) -> None:
        """See :class:`twin.fabric.bus.Bus`; nothing is kept."""

    def subscribe(self, key: str, handler: Callable[[Sample], None]) -> Cancel:
        """See :class:`twin.fabric.bus.Bus`."""
        entry = (key, handler)
        self._subscribers.append(entry)
        return lambda: self._subscribers.remove(entry)

    def serve(self, key: str, handler: Callable[[bytes, Respond], None]) -> Cancel:
        """See :class:`twin.fabric.bus.Bus`."""
        entry = (key, handler)
        self._services.append(entry)
        return lambda: self._services.remove(entry)

    def request(self, key: str, payload: bytes, timeout_s: float) -> bytes | None:
        """See :class:`twin.fabric.bus.Bus`; needs the hub's pump to run."""
        arrived = threading.Event()
        answers: list[bytes] = []

        def answer(data: bytes) -> None:
            answers.append(data)
            arrived.set()

        self.ask(key, payload, answer)
        arrived.wait(timeout_s)
        return answers[0] if answers else None

    def gather(self, key: str, payload: bytes, timeout_s: float) -> list[bytes]:
        """See :class:`twin.fabric.bus.Bus`; needs the hub's pump to run."""
        asked = sum(
            intersects(key, pattern) for bus in self._hub.sessions() for pattern, _ in bus._services
        )
        arrived = threading.Semaphore(0)
        answers: list[bytes] = []

        def answer(data: bytes) -> None:
            answers.append(data)
            arrived.release()

        self.ask(key, payload, answer)
        until_s = time.monotonic() + timeout_s
        for _ in range(asked):
            arrived.acquire(timeout=max(0.0, until_s - time.monotonic()))
        return answers[:]

    def ask(self, key: str, payload: bytes, answer: Callable[[bytes], None]) -> None:
        """Request without waiting: ``answer`` is called if and when a reply arrives."""
        if self.closed:
            return

        def respond(data: bytes) -> None:
            self._hub.post(lambda: None if self.closed else answer(data))

        for bus in self._hub.sessions():
            for pattern, handler in list(bus._services):
                if intersects(pattern, key):
                    self._hub.post(lambda b=bus, h=handler: b.closed or h(payload, respond))  # type: ignore[misc]

    def announce(self, key: str) -> None:
        """See :class:`twin.fabric.bus.Bus`."""
        self._hub.token(key, self)

    def watch(self, key: str, handler: Callable[[str, bool], None]) -> None:
        """See :class:`twin.fabric.bus.Bus`."""
        self._watchers.append((key, handler))
        for token in self._hub.tokens():
            self.hear_token(token, True)

    def hear_token(self, key: str, alive: bool) -> None:
        """A token came or went somewhere on the hub."""
        for pattern, handler in list(self._watchers):
            if matches(pattern, key) and not self.closed:
                handler(key, alive)

    def close(self) -> None:
        """See :class:`twin.fabric.bus.Bus`."""
        if self.closed:
            return
        self.closed = True
        for key, bus in self._hub.tokens().items():
            if bus is self:
                self._hub.token(key, None)


def matches(pattern: str, key: str) -> bool:
    """Zenoh's key expressions: ``*`` is one chunk, ``**`` any number of chunks."""
    return _match(pattern.split("/"), key.split("/"))


def intersects(one: str, other: str) -> bool:
    """Whether some key matches both key expressions."""
    return _meet(one.split("/"), other.split("/"))


def _meet(one: list[str], other: list[str]) -> bool:
    if not one or not other:
        return all(chunk == "**" for chunk in one or other)
    if one[0] == "**":
        return any(_meet(one[1:], other[i:]) for i in range(len(other) + 1))
    if other[0] == "**":
        return _meet(other, one)
    if one[0] != other[0] and "*" not in (one[0], other[0]):
        return False
    return _meet(one[1:], other[1:])


def _match(pattern: list[str], key: list[str]) -> bool:
    if not pattern:
        return not key
    if pattern[0] == "**":
        return any(_match(pattern[1:], key[i:]) for i in range(len(key) + 1))
    if not key or pattern[0] not in ("*", key[0]):
        return False
    return _match(pattern[1:], key[1:])


def _guarded(
    bus: MemoryBus, handler: Callable[[Sample], None], sample: Sample
) -> Callable[[], None]:
    return lambda: None if bus.closed else handler(sample)
