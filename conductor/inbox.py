"""What waits for the conductor's turn: bounded in number and bytes, filled from many threads."""

from __future__ import annotations

import queue
import threading
import time

from conductor.engine import Message
from schemas import SCHEMA_VERSION
from schemas.messages import Reply
from schemas.wire import MESSAGE_BYTES_MAX, encode
from twin.fabric.bus import Respond

GROUP_MAX = 64
"""Most messages in one transaction."""
WAITING_MAX = 10_000
"""Most messages waiting for their turn; more are refused and asked again."""
HINTS_WAITING_MAX = 2 * WAITING_MAX
"""With so many waiting, hints about vanished workers are left out."""
WAITING_BYTES_MAX = 256 << 20
"""Most of them together [bytes]."""

Item = tuple[Message, Respond]


class Inbox:
    """A queue of messages; what does not fit is answered at once, unread."""

    def __init__(self) -> None:
        self.turned_away = 0
        """Messages that were too large, or came when too many were waiting."""
        # Reentrant, so that a signal handler may call wake() in the middle of a get().
        self._items: queue.SimpleQueue[Item | None] = queue.SimpleQueue()
        self._bytes = 0
        self._lock = threading.Lock()

    def receive(self, payload: bytes, respond: Respond, door: str = "") -> None:
        """A request came in, on the key ``door`` if on any; from any thread."""
        size = len(payload)
        if size > MESSAGE_BYTES_MAX:
            # Unread, so that it does not wait in memory with others of its kind.
            error = f"message of {size} bytes, at most {MESSAGE_BYTES_MAX} are accepted"
            self._turn_away(respond, error, 0.0)
            return
        with self._lock:
            fits = self._items.qsize() < WAITING_MAX and self._bytes + size <= WAITING_BYTES_MAX
            if fits:
                self._bytes += size
        if fits:
            self._items.put((Message(payload, time.monotonic_ns(), door=door), respond))
            return
        self._turn_away(respond, "busy: too many requests are waiting; retry", 1.0)

    def hint(self, worker: str) -> None:
        """The session of ``worker`` has vanished; from any thread."""
        if self._items.qsize() >= HINTS_WAITING_MAX:
            return  # its leases expire without it, only later
        message = Message(b"", time.monotonic_ns(), vanished=worker)
        self._items.put((message, lambda _: None))

    def wake(self) -> None:
        """Let :meth:`group` return; from any thread and from a signal handler."""
        self._items.put(None)

    def group(self, timeout_s: float) -> list[Item]:
        """Wait for messages; up to ``GROUP_MAX`` of those that are there."""
        group = []
        try:
            item = self._items.get(timeout=timeout_s)
            while item is not None:
                group.append(item)
                if len(group) == GROUP_MAX:
                    break
                item = self._items.get_nowait()
        except queue.Empty:
            pass
        with self._lock:
            self._bytes -= sum(len(message.payload) for message, _ in group)
        return group

    def _turn_away(self, respond: Respond, error: str, retry_after_s: float) -> None:
        with self._lock:
            self.turned_away += 1
        respond(encode(Reply(v=SCHEMA_VERSION, epoch=0, error=error, retry_after_s=retry_after_s)))
