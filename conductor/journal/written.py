"""What one transaction has written to a journal, for whoever keeps a copy of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from conductor.journal.chain import Chain

Row = tuple[float, bytes, bytes]
"""A fact: time [unix s], its bytes, head of the chain after it."""


@dataclass(slots=True)
class Written:
    """Rows in order; what a snapshot has replaced is left out."""

    facts: list[Row] = field(default_factory=list)
    images: list[tuple[str, bytes]] = field(default_factory=list)
    replies: dict[str, tuple[int, bytes] | None] = field(default_factory=dict)
    """Worker -> number and bytes of its latest reply; None: it is forgotten."""
    cut: bool = False
    """Whether a snapshot was taken: earlier facts are gone."""
    whole: bool = False
    """Whether this is all of the journal: whatever a copy has is replaced."""
    chain: Chain = field(default_factory=Chain)
    """Where the journal stands then."""

    @property
    def size(self) -> int:
        """Length of the rows [bytes]."""
        replies = sum(len(reply[1]) for reply in self.replies.values() if reply)
        facts = sum(len(fact) + 48 for _, fact, _ in self.facts)
        return facts + replies + sum(len(data) for _, data in self.images) + 64


class JournalMirror(Protocol):
    """Who keeps a copy; called on the journal's thread, and never waits."""

    def committed(self, written: Written) -> None:
        """A transaction is on disk."""

    def wants_all(self) -> bool:
        """Whether the copy has to begin anew."""

    def check(self) -> None:
        """Raise :class:`conductor.journal.owner.TakenOverError` if another conductor owns the copy
        now."""
