"""Forks: from a moment of a case on, its random numbers are those of another name.

Random numbers are keyed by a name and counted by the case's tick, so a case with forks runs as its
parent does until the moment, and otherwise from there on, on any worker and from its start.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

FORKS_MAX = 1000
"""Most forks of one case."""


class Fork(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A moment of a case, and whose random numbers hold from there on.

    The moment is the first tick that is no earlier than `tick`, and comes after one at which the
    KPI column had passed its limit by the margin. Forks of a case come one after the other.
    """

    case: str
    """Name that keys the random numbers."""
    tick: Annotated[int, Meta(ge=0)] = 0
    """Earliest tick of the case."""
    column: str = ""
    """KPI column that is waited for; empty: none."""
    size: bool = False
    """Whether the column counts without its sign."""
    above: bool = False
    """Whether the column comes from below its limit: the margin is the limit less the column.
    Otherwise it is the column less the limit."""
    limit: float = 0.0
    """Limit, in the column's unit."""
    margin: float = 0.0
    """The column's margin was smaller than this, in its unit."""

    def margin_of(self, value: float) -> float:
        """Margin of a value of the column; the same operation as that of a search's margins, so
        that both have the same bits."""
        value = abs(value) if self.size else value
        return self.limit - value if self.above else value - self.limit


class Branch(Struct, frozen=True, forbid_unknown_fields=True):
    """What a proposed case of a search is a fork of."""

    parent: str
    """Name of a case of an earlier generation."""
    margin: float
    """It goes its own way when the parent's margin had become smaller than this."""
