"""What the simulator's loop tells those who look: the feed, no feed, and a feed that may fail."""

from __future__ import annotations

import contextlib
import traceback
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from schemas.messages import Command, Lease
from twin.fabric.bus import Respond

if TYPE_CHECKING:
    from twin.rig.engine import Engine, Finished
    from twin.sensors.data import SensorData


class Feed(Protocol):
    """What the simulator's loop tells; every call returns at once."""

    endpoint: str
    """Where a recorder connects; empty: there is none to come."""

    def begin(self, slot: int, lease: Lease, engine: Engine) -> None:
        """A case begins in ``slot``."""

    def tick(
        self, engine: Engine, sensed: dict[str, SensorData], commands: list[Command | None]
    ) -> None:
        """All active slots are at a tick, sensed and commanded, not yet stepped."""

    def steered_by(self, ask: Callable[[int, bytes, Respond], None]) -> None:
        """Who takes requests of viewers, ``ask(slot, payload, respond)`` from any thread."""

    def hand(self, slot: int, label: str) -> None:
        """What views say of a slot that somebody has touched: ``paused``, ``by hand`` ...; again
        and again of one that stands still."""

    def end(self, finished: Finished) -> None:
        """The case of a slot has ended."""

    def abandon(self, slot: int) -> None:
        """The case of a slot is no longer wanted."""

    def turn_away(self) -> None:
        """Take no more requests of viewers."""

    def close(self, timeout_s: float) -> None:
        """Publish what waits and say that nothing follows; gives up after ``timeout_s`` [s]."""


class NoFeed:
    """Nobody looks."""

    endpoint = ""

    def begin(self, slot: int, lease: Lease, engine: Engine) -> None:
        """See :class:`Feed`."""

    def tick(
        self, engine: Engine, sensed: dict[str, SensorData], commands: list[Command | None]
    ) -> None:
        """See :class:`Feed`."""

    def steered_by(self, ask: Callable[[int, bytes, Respond], None]) -> None:
        """See :class:`Feed`."""

    def hand(self, slot: int, label: str) -> None:
        """See :class:`Feed`."""

    def end(self, finished: Finished) -> None:
        """See :class:`Feed`."""

    def abandon(self, slot: int) -> None:
        """See :class:`Feed`."""

    def turn_away(self) -> None:
        """See :class:`Feed`."""

    def close(self, timeout_s: float) -> None:
        """See :class:`Feed`."""


class Harmless:
    """Passes on to a feed until that fails, once: whoever looks must not break what they see."""

    def __init__(self, feed: Feed) -> None:
        self.endpoint = feed.endpoint
        self._feed = feed

    def begin(self, slot: int, lease: Lease, engine: Engine) -> None:
        """See :class:`Feed`."""
        self._try(lambda: self._feed.begin(slot, lease, engine))

    def tick(
        self, engine: Engine, sensed: dict[str, SensorData], commands: list[Command | None]
    ) -> None:
        """See :class:`Feed`."""
        self._try(lambda: self._feed.tick(engine, sensed, commands))

    def steered_by(self, ask: Callable[[int, bytes, Respond], None]) -> None:
        """See :class:`Feed`."""
        self._try(lambda: self._feed.steered_by(ask))

    def hand(self, slot: int, label: str) -> None:
        """See :class:`Feed`."""
        self._try(lambda: self._feed.hand(slot, label))

    def end(self, finished: Finished) -> None:
        """See :class:`Feed`."""
        self._try(lambda: self._feed.end(finished))

    def abandon(self, slot: int) -> None:
        """See :class:`Feed`."""
        self._try(lambda: self._feed.abandon(slot))

    def turn_away(self) -> None:
        """See :class:`Feed`."""
        self._try(self._feed.turn_away)

    def close(self, timeout_s: float) -> None:
        """See :class:`Feed`."""
        self._try(lambda: self._feed.close(timeout_s))

    def _try(self, call: Callable[[], None]) -> None:
        try:
            call()
        except Exception:
            traceback.print_exc()
            failed, self._feed = self._feed, NoFeed()
            # Nobody would cancel the keys of cases when these end, and the slots go to others.
            with contextlib.suppress(Exception):
                failed.turn_away()
