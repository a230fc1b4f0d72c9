"""Progress of a command: a bar on a terminal, a line now and then in a log file; on stderr."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from typing import Protocol

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)

LINES = 20
"""Lines of progress in a log file."""


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
    """Report through what this yields.

    Args:
        name: stands before a line.
        doing: stands before the bar.
        unit: what is counted.
    """
    console = Console(stderr=True)
    if not console.is_terminal:
        yield _Lines(name, unit)
        return
    columns = (
        TextColumn(doing),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as bar:
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
