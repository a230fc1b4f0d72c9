"""Names of what the ego can come near or hit: one entry per hull of a world."""

from __future__ import annotations

from dataclasses import dataclass

from schemas.escape import escape

NAME_MAX = 60
"""Longest name that is kept [characters]."""


@dataclass(frozen=True, slots=True)
class Thing:
    """The object behind a hull."""

    name: str
    """Name in the scene; of unnamed things kind and number."""
    kind: str
    """Class of a box sensor's object, or what else it is, such as ``building``."""
    hull: int = 1
    """Which of its hulls it is, counted from 1."""
    hulls: int = 1

    @property
    def words(self) -> str:
        """Name in reasons: ``'oncoming van' (car)``, ``'trailer' (truck, hull 2 of 2)``."""
        which = f", hull {self.hull} of {self.hulls}" if self.hulls > 1 else ""
        return f"'{self.name}' ({self.kind}{which})"


def named(name: str, kind: str) -> Thing:
    """A thing with a name that somebody wrote into a file."""
    return Thing(escape(name, NAME_MAX), kind)


def numbered(what: str, kind: str, count: int) -> list[Thing]:
    """Unnamed things of one sort, numbered from 1."""
    return [Thing(f"{what} {number}", kind) for number in range(1, count + 1)]
