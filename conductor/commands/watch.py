"""``conductor status --watch``: a table that lives off the conductor's events.

An event says that something has changed; what, is asked. So a lost event costs a second, and a
conductor that comes back is seen as it is.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from typing import Protocol

from rich.console import Console
from rich.live import Live
from rich.text import Text

from conductor.commands.pace import Pace, shown_time
from conductor.commands.tables import alarms, status_view
from schemas.wire.status import ConductorStatus
from schemas.words import counted
from twin.base.errors import EXIT_PASS, TwinError

POLL_S = 1.0
"""Status is asked for at least this often [s]."""
HASTE_S = 0.2
"""Status is asked for at most this often, however many events come [s]."""


class StatusSource(Protocol):
    """Where status and events come from; see :class:`conductor.commands.client.ConductorClient`."""

    def status(self) -> ConductorStatus:
        """The conductor's state."""

    def on_event(self, handler: Callable[[], None]) -> None:
        """Call ``handler`` at every event, on a thread of the bus."""


class Watched:
    """State of the watch so far: the last status and the pace of each campaign."""

    def __init__(self) -> None:
        self.found: ConductorStatus = {}
        self.paces: dict[str, Pace] = {}

    def saw(self, found: ConductorStatus, now_s: float) -> None:
        """A status, asked for at ``now_s``."""
        self.found = found
        for name, row in found["campaigns"].items():
            self.paces.setdefault(name, Pace()).saw(row["cases"] - row["left"], now_s)

    @property
    def over(self) -> bool:
        """Whether there were campaigns and nothing is left of them."""
        return bool(self.found.get("campaigns")) and not self.found["left"]

    def lines(self) -> list[str]:
        """One line per campaign, for a log file, then alarms."""
        lines = []
        for name, row in self.found["campaigns"].items():
            pace = self.paces[name]
            rate = "-" if pace.per_s is None else f"{pace.per_s:.2f}"
            eta = shown_time(pace.eta_s(row["left"]))
            lines.append(
                f"{name}: {row['cases'] - row['left']} of {counted(row['cases'], 'case')} ended, "
                f"{row['leased']} running, {rate} cases/s, ETA {eta}"
            )
        return lines + alarms(self.found)


def watch(source: StatusSource, console: Console, *, as_json: bool) -> int:
    """Show the status until everything has ended; Ctrl-C raises KeyboardInterrupt.

    Args:
        source: of status and events.
        console: a terminal gets a live table, anything else a line per change.
        as_json: a JSON object per change instead.
    """
    changed = threading.Event()
    source.on_event(changed.set)
    watched = Watched()
    if as_json or not console.is_terminal:
        return _plain(source, watched, changed, console, as_json)
    with Live(console=console, auto_refresh=False, transient=False) as live:
        while True:
            silence = _ask(source, watched)
            if watched.found:
                live.update(status_view(watched.found, watched.paces), refresh=True)
            if silence:
                live.update(Text(silence, style="red"), refresh=True)
            if watched.over and not silence:
                return EXIT_PASS
            _wait(changed)


def _plain(
    source: StatusSource,
    watched: Watched,
    changed: threading.Event,
    console: Console,
    as_json: bool,
) -> int:
    before: object = None
    while True:
        silence = _ask(source, watched)
        if silence and silence != before:
            console.print(silence, markup=False, soft_wrap=True)
            before = silence
        if not silence and _counts(watched.found) != before:
            before = _counts(watched.found)
            if as_json:
                print(json.dumps(watched.found), flush=True)
            else:
                for line in watched.lines():
                    console.print(line, markup=False, soft_wrap=True)
        if watched.over and not silence:
            return EXIT_PASS
        _wait(changed)


def _ask(source: StatusSource, watched: Watched) -> str:
    """Take in a status; why there is none, in one line, or nothing.

    Raises:
        TwinError: the very first one; afterwards a conductor may go away and come back.
    """
    try:
        watched.saw(source.status(), time.monotonic())
    except TwinError as error:
        if not watched.found:
            raise
        return f"{error}; still watching"
    return ""


def _wait(changed: threading.Event) -> None:
    """Until the next event, but not for long and not for nothing."""
    changed.wait(POLL_S)
    changed.clear()
    time.sleep(HASTE_S)


def _counts(status: ConductorStatus) -> object:
    """Counts that a line per change is about: not the ages of workers."""
    return json.dumps([status["campaigns"], status["notes"], status.get("storage_error")])
