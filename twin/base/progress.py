"""Progress of a command on stderr: bars on a terminal, and of some a line now and then in a log.

A command opens :func:`bars`; what it calls goes through its cases, pictures or rounds by
:func:`steps`, or counts them with :func:`counter`. Where no bars are open, as in workers and in
programs, nothing is counted. Bars are drawn between two steps only, so a measurement is not
disturbed while it lasts.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from contextvars import ContextVar
from typing import TYPE_CHECKING, Protocol, TypeVar

# Rich is imported late: what only counts, for nobody, need not wait for it.
if TYPE_CHECKING:
    from rich.progress import Progress, ProgressColumn, TaskID

LINES = 20
"""Lines of progress in a log file."""
REDRAW_S = 0.1
"""Least time between two pictures of a bar that is on its way [s]."""
BAR_WIDTH = 24
"""Characters of a bar."""

BYTES = "bytes"
"""What is counted in bytes is shown in MB."""

Told = Callable[[str, int, int], None]
"""A listener to progress: what is counted, how many are done, and how many there are."""
T = TypeVar("T")

_told: ContextVar[Told | None] = ContextVar("told", default=None)
"""Who listens; None: nobody."""


def steps(what: str, items: Collection[T]) -> Iterable[T]:
    """``items`` one after the other; whoever shows bars hears when one is done.

    Args:
        what: their unit, such as ``KPI files``.
        items: what is gone through.
    """
    told = _told.get()
    return items if told is None else _counted(told, what, items)


def _counted(told: Told, what: str, items: Collection[T]) -> Iterator[T]:
    told(what, 0, len(items))
    for done, item in enumerate(items, 1):
        yield item
        told(what, done, len(items))


def counter(what: str, total: int) -> Callable[[int], None]:
    """A function that is told how many more of ``total`` are done, for work that is no loop."""
    told = _told.get()
    if told is None:
        return _nothing
    told(what, 0, total)
    done = 0

    def more(count: int) -> None:
        nonlocal done
        done += count
        told(what, done, total)

    return more


def _nothing(_count: int) -> None:
    """Nobody listens."""


@contextlib.contextmanager
def bars() -> Iterator[Told]:
    """Show a bar on a terminal for each thing that is counted while the block lasts, with its rate
    and its expected end; elsewhere nothing. Results are printed after the block.

    Yields:
        A listener, for who passes it on by hand.
    """
    if not sys.stderr.isatty():
        yield lambda _what, _done, _total: None
        return
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    # Standard output is the results'; Rich would move it to stderr.
    shown = Progress(*_columns(), console=console, auto_refresh=False, redirect_stdout=False)
    with shown:
        told = _Bars(shown)
        before = _told.set(told)
        try:
            yield told
        finally:
            _told.reset(before)


class _Bars:
    """A row for each thing that is counted; what begins anew gets another one."""

    def __init__(self, shown: Progress) -> None:
        self._shown = shown
        self._rows: dict[str, TaskID] = {}
        self._drawn_s = 0.0

    def __call__(self, what: str, done: int, total: int, /) -> None:
        if total == 0:
            return
        if done == 0 or what not in self._rows:
            self._rows[what] = self._shown.add_task(what, total=total)
        self._shown.update(self._rows[what], completed=done)
        now_s = time.monotonic()
        if done in (0, total) or now_s - self._drawn_s >= REDRAW_S:
            self._drawn_s = now_s
            self._shown.refresh()


def _columns(unit: str = "") -> list[ProgressColumn]:
    """What is counted, a bar, how much of it is done, the rate, and the expected end."""
    from rich import progress as rich
    from rich.filesize import decimal
    from rich.text import Text

    def size(task: rich.Task, count: float) -> str:
        return decimal(int(count)) if task.description == BYTES else f"{count:,.4g}"

    class _Amount(rich.ProgressColumn):
        """Steps that are done, of all."""

        def render(self, task: rich.Task) -> Text:
            if task.total is None or task.description != BYTES:
                return rich.MofNCompleteColumn().render(task)
            return Text(f"{decimal(int(task.completed))}/{decimal(int(task.total))}")

    class _Rate(rich.ProgressColumn):
        """Steps per second; nothing before the second one."""

        def render(self, task: rich.Task) -> Text:
            speed = task.finished_speed or task.speed
            return Text("" if speed is None else f"{size(task, speed)}/s")

    return [
        rich.TextColumn("{task.description}"),
        rich.BarColumn(BAR_WIDTH),
        rich.TaskProgressColumn(),
        _Amount(),
        *([rich.TextColumn(unit)] if unit else []),
        _Rate(),
        rich.TimeRemainingColumn(elapsed_when_finished=True),
    ]


class ProgressReport(Protocol):
    """A function that is told how far something is."""

    def __call__(self, done: int, total: int, /) -> None:
        """``done`` of ``total`` are done."""
        ...

    def say(self, line: str) -> None:
        """A line that stays."""
        ...


@contextlib.contextmanager
def progress(name: str, doing: str, unit: str) -> Iterator[ProgressReport]:
    """Report through what this yields, of work that is worth lines in a log file, too.

    Args:
        name: stands before a line.
        doing: stands before the bar.
        unit: what is counted.
    """
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    if not console.is_terminal:
        yield _Lines(name, unit)
        return
    with Progress(*_columns(unit), console=console) as bar:
        yield _Bar(name, bar, bar.add_task(doing, total=None))


class _Bar:
    """A bar; lines go above it."""

    def __init__(self, name: str, bar: Progress, task: TaskID) -> None:
        self._name, self._bar, self._task = name, bar, task

    def __call__(self, done: int, total: int, /) -> None:
        self._bar.update(self._task, completed=done, total=total)

    def say(self, line: str) -> None:
        self._bar.console.print(f"{self._name}: {line}", markup=False, highlight=False)


class _Lines:
    """A line whenever another twentieth is done."""

    def __init__(self, name: str, unit: str) -> None:
        self._name, self._unit = name, unit
        self._step = -1

    def __call__(self, done: int, total: int, /) -> None:
        step = done * LINES // total
        if step != self._step:
            self._step = step
            self.say(f"{done} of {total} {self._unit}")

    def say(self, line: str) -> None:
        print(f"{self._name}: {line}", file=sys.stderr, flush=True)
