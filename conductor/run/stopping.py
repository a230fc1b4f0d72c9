"""Stopping a run by SIGINT and SIGTERM."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator

from twin.base.command import heed_signals


class Interrupted(BaseException):
    """A signal asks the run to stop; ``number`` says which.

    No :class:`Exception`: it may be raised in the middle of a library that catches those.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


class Signals:
    """The first SIGINT or SIGTERM of a run raises :class:`Interrupted`; later ones do nothing.

    Off the main thread no signal arrives: there a run is stopped by :meth:`ask`.
    """

    def __init__(self) -> None:
        self.held = False
        """A signal waits until :meth:`release`. Set as an attribute, because a call can itself be
        interrupted before it has done anything."""
        self._stop: Interrupted | None = None

    def receive(self, number: int, _frame: object) -> None:
        """The handler."""
        for handled in (signal.SIGINT, signal.SIGTERM):
            signal.signal(handled, signal.SIG_IGN)
        self._stop = Interrupted(number)
        if not self.held:
            raise self._stop

    def ask(self, number: int) -> None:
        """Ask the run to stop as the signal ``number`` would, from another thread: it is raised
        when the run next calls :meth:`release`."""
        self._stop = Interrupted(number)

    def release(self) -> None:
        """Raise what came while signals were held, or was swallowed by what it hit."""
        self.held = False
        if self._stop is not None:
            raise self._stop


@contextlib.contextmanager
def heeded() -> Iterator[Signals]:
    """SIGINT and SIGTERM go to the run while the block lasts."""
    signals = Signals()
    previous = {n: signal.signal(n, signals.receive) for n in (signal.SIGINT, signal.SIGTERM)}
    try:
        heed_signals()
        yield signals
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
