"""What was written to a journal, for whoever keeps a copy of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from conductor.journal.chain import Chain

Row = tuple[float, bytes, bytes]
"""A fact: time [unix s], its bytes, head of the chain after it."""

Reply = tuple[str, int, bytes]
"""Worker, number and bytes of its latest reply; without bytes: it is forgotten."""


@dataclass(slots=True)
class Changes:
    """Which rows of a journal a copy has not got; the rows themselves stay where they are."""

    images: set[str] = field(default_factory=set)
    """Keys of images of the snapshot."""
    workers: set[str] = field(default_factory=set)
    """Workers with another reply, or with none any more."""
    cut: bool = False
    """Whether a snapshot was taken: earlier facts are gone."""

    def add(self, other: Changes) -> None:
        """Take in what is not in the copy either."""
        self.images |= other.images
        self.workers |= other.workers
        self.cut |= other.cut


@dataclass(slots=True)
class JournalPart:
    """Some rows, in order: later ones replace earlier ones of the same key."""

    facts: list[Row] = field(default_factory=list)
    images: list[tuple[str, bytes]] = field(default_factory=list)
    replies: list[Reply] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class JournalPoint:
    """Where a journal stood between two transactions."""

    chain: Chain
    cuts: int
    """Snapshots that this process had taken."""
    last: int
    """Number of the last fact; 0: there is none."""
    replies: list[Reply]
    """Those that were asked for."""


class JournalMirror(Protocol):
    """Who keeps a copy; called on the journal's thread, and never waits."""

    def committed(self, changes: Changes) -> None:
        """A transaction is on disk. The rows can be read by :class:`JournalRows` later."""

    def check(self) -> None:
        """Raise :class:`conductor.journal.owner.TakenOverError` if another conductor owns the copy
        now."""
