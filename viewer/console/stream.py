"""Numbered events for pages: who comes back is sent what it missed, or told to ask for all anew."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import msgspec

EVENTS_MAX = 2048
"""Events that are kept for pages that come back; an older one makes a page ask for all anew."""
EVENT_BYTES_MAX = 16 << 20
"""Most bytes of kept events."""
FOLLOWERS_MAX = 32
"""Pages that follow at the same time, at most."""
HEARTBEAT_S = 5.0
"""Longest silence on a stream [s]."""


@dataclass(frozen=True, slots=True)
class StreamEvent:
    """One event as it is sent."""

    number: int
    text: bytes
    """Lines of a server-sent event, the empty one included."""


class EventStream:
    """Written by one thread, followed by any number."""

    def __init__(self, epoch: str, events_max: int = EVENTS_MAX, bytes_max: int = EVENT_BYTES_MAX):
        """``epoch``: differs from that of every earlier stream, so that no number of another one
        is taken for one of ours; letters, digits and ``_``."""
        self.epoch = epoch
        self._events: deque[StreamEvent] = deque()
        self._events_max, self._bytes_max = events_max, bytes_max
        self._bytes = 0
        self._next = 1
        self._closed = False
        self.followers = 0
        """Pages that follow."""
        self._changed = threading.Condition()

    def put(self, kind: str, data: Any) -> None:
        """Add an event; ``data`` is sent as JSON."""
        with self._changed:
            number = self._next
            self._next += 1
            event = StreamEvent(number, sse(kind, data, f"{self.epoch}-{number}"))
            self._events.append(event)
            self._bytes += len(event.text)
            while len(self._events) > self._events_max or self._bytes > self._bytes_max:
                self._bytes -= len(self._events.popleft().text)
            self._changed.notify_all()

    @contextmanager
    def followed(self) -> Iterator[bool]:
        """A page follows meanwhile; False: too many do."""
        with self._changed:
            welcome = self.followers < FOLLOWERS_MAX
            self.followers += welcome
        try:
            yield welcome
        finally:
            with self._changed:
                self.followers -= welcome

    def close(self) -> None:
        """Let all who follow go."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def closed(self) -> bool:
        """Whether nothing comes any more."""
        return self._closed

    def after(self, last_id: str) -> tuple[int, bool]:
        """Where a page goes on that has seen ``last_id``; empty: it is new.

        Returns:
            The number to follow from, and whether something lies between that is not kept any more,
            or was of another server: then the page asks for everything anew.
        """
        epoch, _, text = last_id.rpartition("-")
        with self._changed:
            newest = self._next - 1
            if not last_id:
                return newest, False
            if epoch != self.epoch or not (text.isascii() and text.isdecimal()) or len(text) > 18:
                return newest, True
            number = int(text)
            oldest = self._events[0].number if self._events else self._next
            if number > newest or number + 1 < oldest:
                return newest, True
            return number, False

    def wait(self, number: int, timeout_s: float) -> list[StreamEvent] | None:
        """Events after ``number``; waits for the first of them for at most ``timeout_s`` [s].

        None: some of them are not kept any more, because whoever follows is too slow.
        """
        with self._changed:
            if self._next - 1 <= number and not self._closed:
                self._changed.wait(timeout_s)
            if self._events and self._events[0].number > number + 1:
                return None
            missing = self._next - 1 - number
            return list(self._events)[-missing:] if missing > 0 else []


def sse(kind: str, data: Any, number: str = "") -> bytes:
    """A server-sent event. JSON has no line breaks of its own, so nothing in ``data`` can begin
    another field."""
    head = b"id: " + number.encode() + b"\n" if number else b""
    return head + b"event: " + kind.encode() + b"\ndata: " + msgspec.json.encode(data) + b"\n\n"


BEAT = sse("beat", {})
"""Says that the stream stands."""
