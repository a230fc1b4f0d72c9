"""The bar of a run on a terminal or in a notebook; elsewhere a redrawn bar is noise."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from conductor.run.listener import RunProgress


class BarListener:
    """Prints what a run says; see :class:`conductor.run.listener.RunListener`."""

    def __init__(self, console: Console) -> None:
        self._bars = _bars(console)
        self._bar: TaskID | None = None

    def say(self, line: str) -> None:
        """Print a line, above the bar."""
        self._bars.console.print(line, markup=False, soft_wrap=True)

    @contextlib.contextmanager
    def watching(self) -> Iterator[None]:
        """Show the bar while the block lasts."""
        with self._bars:
            yield

    def progress(self, progress: RunProgress) -> None:
        """Move the bar."""
        if self._bar is None:
            self._bar = self._bars.add_task(progress.campaign, total=None, note="starting")
        note = f"{progress.passed} passed, {progress.running} running"
        self._bars.update(self._bar, total=progress.cases, completed=progress.ended, note=note)


def _bars(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
    )
