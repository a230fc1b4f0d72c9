"""The bus: publish, subscribe, request, liveliness. Implemented over Zenoh and in memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

Respond = Callable[[bytes], None]
"""Answers a request, once, from any thread."""

Cancel = Callable[[], None]
"""Ends a subscription."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One received message; ``key`` is below the namespace."""

    key: str
    payload: bytes
    attachment: bytes


class Bus(Protocol):
    """A session of the fabric. Handlers run on the session's own threads and must not block."""

    endpoints: list[str]
    """Where this session listens, with real port numbers (``tcp/127.0.0.1:43127``)."""

    def publish(
        self, key: str, payload: bytes, attachment: bytes = b"", *, block: bool = False
    ) -> None:
        """Publish; ``block`` waits for a congested peer, otherwise the message may be dropped."""

    def wanted(self, key: str) -> bool:
        """Whether somebody subscribes to ``key`` (may hold ``*`` and ``**``); cheap to ask."""

    def release(self, key: str) -> None:
        """Forget what :meth:`wanted` keeps about ``key``; for keys that will not be asked again."""

    def subscribe(self, key: str, handler: Callable[[Sample], None]) -> Cancel:
        """Call ``handler`` with each message on ``key`` (may hold ``*`` and ``**``), until the
        answer is called or the session ends."""

    def serve(self, key: str, handler: Callable[[bytes, Respond], None]) -> Cancel:
        """Answer requests on ``key``; ``handler(payload, respond)``; until the answer is called or
        the session ends."""

    def request(self, key: str, payload: bytes, timeout_s: float) -> bytes | None:
        """Ask; None means unknown (no answer, several answers, or an error): ask again."""

    def gather(self, key: str, payload: bytes, timeout_s: float) -> list[bytes]:
        """Ask everybody who serves a key that ``key`` (may hold ``*`` and ``**``) means; the
        answers, at most one per key that is served."""

    def announce(self, key: str) -> None:
        """Declare a liveliness token, seen by watchers until this session ends."""

    def watch(self, key: str, handler: Callable[[str, bool], None]) -> None:
        """Call ``handler(key, alive)`` as liveliness tokens come and go."""

    def close(self) -> None:
        """End the session; further calls do nothing."""
