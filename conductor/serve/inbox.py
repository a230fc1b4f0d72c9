"""What waits for the conductor's turn: bounded in number and bytes, filled from many threads."""

from __future__ import annotations

import contextlib
import itertools
import queue
import threading
import time
from collections import deque
from collections.abc import Callable

from conductor.serve.companions import Companions
from conductor.serve.engine import IncomingRequest
from schemas import SCHEMA_VERSION
from schemas.wire import topics
from schemas.wire.codec import encode
from schemas.wire.control import Reply
from schemas.wire.rpc_routes import RPC_ROUTES, bytes_max
from twin.fabric.bus import Respond

GROUP_MAX = 64
"""Most messages in one transaction."""
WAITING_MAX = 10_000
"""Most messages waiting for their turn; more are refused and asked again."""
OTHERS_WAITING_MAX = 1_000
"""Most of them that are no worker's, by the key on which they came."""
HINTS_WAITING_MAX = 2 * WAITING_MAX
"""Number of waiting messages with which hints about vanished workers are left out."""
WAITING_BYTES_MAX = 256 << 20
"""Most of them together [bytes]."""

Item = tuple[IncomingRequest, Respond]

_OTHERS = RPC_ROUTES.keys() - {topics.RPC_WORKER.key}


class Inbox:
    """Messages wait in a lane for each key, and the lanes take turns: who asks too much waits for
    himself. What does not fit is answered at once, unread."""

    def __init__(self, heard: Callable[[str, str], None] = lambda *_: None) -> None:
        """``heard``: of messages that are turned away, with the key on which they came."""
        self._heard = heard
        self.turned_away = 0
        """Messages that were too large, or came when too many were waiting."""
        # Reentrant, so that a signal handler may call wake() in the middle of a get(). It holds a
        # True for each message in a lane.
        self._bells: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self._lanes: dict[str, deque[Item]] = {key: deque() for key in ("", *RPC_ROUTES)}
        self._bytes = 0
        self._lock = threading.Lock()

    def receive(self, payload: bytes, respond: Respond, route: str = "") -> None:
        """A request came in, on the RPC route ``route`` if on any; from any thread."""
        size = len(payload)
        if size > (most := bytes_max(route)):
            # Unread, so that it does not wait in memory with others of its kind.
            error = f"message of {size} bytes, at most {most} are accepted"
            self._turn_away(respond, route, error, 0.0)
            return
        lane = self._lanes[route]
        may_wait = OTHERS_WAITING_MAX if route in _OTHERS else WAITING_MAX
        with self._lock:
            fits = len(lane) < may_wait and self._bytes + size <= WAITING_BYTES_MAX
            if fits:
                self._bytes += size
                lane.append((IncomingRequest(payload, time.monotonic_ns(), route=route), respond))
        if fits:
            self._bells.put(True)
            return
        self._turn_away(respond, route, "busy: too many requests are waiting; retry", 1.0)

    def hint(self, worker: str) -> None:
        """The session of ``worker`` has vanished; from any thread."""
        if self._bells.qsize() >= HINTS_WAITING_MAX:
            return  # its leases expire without it, only later
        message = IncomingRequest(b"", time.monotonic_ns(), vanished=worker)
        self._lanes[topics.RPC_WORKER.key].append((message, lambda _: None))
        self._bells.put(True)

    @property
    def waiting(self) -> int:
        """Number of messages that wait, about."""
        return self._bells.qsize()

    def wake(self) -> None:
        """Let :meth:`group` return; from any thread and from a signal handler."""
        self._bells.put(False)

    def group(self, timeout_s: float, companions: Companions | None = None) -> list[Item]:
        """Wait for messages; up to ``GROUP_MAX`` of those that are there.

        ``companions``: for whom it waits a little once there is one; None: for nobody.
        """
        rung = 0
        try:
            message = self._bells.get(timeout=timeout_s)
            while message:
                rung += 1
                if rung == GROUP_MAX:
                    break
                message = self._bells.get_nowait()
        except queue.Empty:
            if rung and companions is not None:
                rung += self._wait_for(companions, rung)
        group: list[Item] = []
        for lane in itertools.cycle(self._lanes.values()):
            if len(group) == rung:
                break
            if lane:
                group.append(lane.popleft())
        with self._lock:
            self._bytes -= sum(len(message.payload) for message, _ in group)
        return group

    def _wait_for(self, companions: Companions, rung: int) -> int:
        """Wait for those that are about to come and share a transaction; how many came."""
        lacking = min(companions.expected, GROUP_MAX) - rung
        left_s = companions.until_s - time.monotonic()
        if lacking <= 0 or left_s <= 0.0:
            return 0
        came = 0
        with contextlib.suppress(queue.Empty):
            while came < lacking and left_s > 0.0 and self._bells.get(timeout=left_s):
                came += 1
                left_s = companions.until_s - time.monotonic()
        companions.waited(came)
        return came

    def _turn_away(self, respond: Respond, route: str, error: str, retry_after_s: float) -> None:
        with self._lock:
            self.turned_away += 1
        self._heard(route, error)
        respond(encode(Reply(v=SCHEMA_VERSION, epoch=0, error=error, retry_after_s=retry_after_s)))
