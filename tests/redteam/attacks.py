"""The table of attacks: what is tried, by whom, and the function that tries it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from theatre import Theatre

Outcome = Literal["refused", "contained", "open", "not run"]
"""``refused``: nothing came of it. ``contained``: it did something that harms nobody else.
``open``: harm was seen. ``not run``: this machine lacks what it needs."""

ROWS = range(1, 18)
"""Numbers of the table that was found; an attack belongs to one of them."""


@dataclass(frozen=True, slots=True)
class Found:
    """What came of an attack, as it was seen."""

    outcome: Outcome
    by: str
    """What stopped it, or what it reached, in a phrase."""


Try = Callable[["Theatre"], Found]


@dataclass(frozen=True, slots=True)
class Attack:
    """One line of the table."""

    row: int
    what: str
    who: str
    rights: str
    attempt: Try
    root: bool = False
    """It needs root, to be two users."""

    @property
    def name(self) -> str:
        """For files."""
        return f"{self.row:02}-{self.attempt.__name__.replace('_', '-')}"


ATTACKS: list[Attack] = []


def attack(
    row: int, what: str, who: str, rights: str, *, root: bool = False
) -> Callable[[Try], Try]:
    """Put a function into the table."""

    def put(attempt: Try) -> Try:
        ATTACKS.append(Attack(row, what, who, rights, attempt, root))
        return attempt

    return put


def refused_if(refused: bool, by: str, reached: str) -> Found:
    """``by`` stopped it, or it ``reached`` something."""
    return Found("refused", by) if refused else Found("open", reached)
