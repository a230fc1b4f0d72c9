"""What a run says while it lasts, and to whom: a terminal, a log file, a program."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class RunProgress:
    """How far a campaign has come."""

    campaign: str
    cases: int
    """Cases that there are; of a search, those that are proposed so far."""
    ended: int
    passed: int
    running: int


class RunListener(Protocol):
    """Hears what a run says, on the run's own thread."""

    def say(self, line: str) -> None:
        """A line for people."""

    def watching(self) -> AbstractContextManager[None]:
        """Lasts while the run waits for cases; :meth:`progress` is called only then."""

    def progress(self, progress: RunProgress) -> None:
        """How far it has come: at every look, whether something has changed or not."""
