"""Which answers of a stack may come: late and doubled ones, and none with a wrong seq."""

from __future__ import annotations

from twin.base.errors import StackFaultError

SEQS_KEPT = 64
"""Number of seqs that are remembered to tell late answers from wrong ones."""

ODD_ANSWERS_MAX = 2
"""Number of answers beyond those allowed that are let pass."""


class Answers:
    """The answers that are due on one drive plane."""

    def __init__(self) -> None:
        self._due: dict[int | None, int] = {}
        """Seq, of the last few, and how many more answers to it may come; None: all others."""

    def asked(self, seq: int) -> None:
        """A seq is published, perhaps again."""
        # What is asked may come twice, and so may what is answered.
        self._due[seq] = self._due.get(seq, ODD_ANSWERS_MAX) + 4
        while len(self._due) > SEQS_KEPT:
            del self._due[next(iter(self._due))]

    def other(self, seq: int, asked: int) -> None:
        """An answer to ``seq`` has come, and not to the one that was ``asked`` last.

        Raises:
            StackFaultError: it cannot be a late one.
        """
        known = seq if seq in self._due else None
        due = self._due[known] = self._due.get(known, ODD_ANSWERS_MAX) - 1
        if seq > asked or due < 0:
            raise StackFaultError(f"stack: answers seq {seq}, asked for {asked}; echo the tick's")
