"""The table of verdict words: how pages, maps and the viewer show each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Level = Literal[0, 1, 2]
LEVEL_UNHURT: Level = 2
"""Level of verdicts without a collision."""
LEVEL_OF_PASSING = 3
"""Level of all verdicts that pass."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictKind:
    """Declaration of a verdict word."""

    name: str
    tone: Literal["good", "doubtful", "bad"]
    """Its colour in the viewer; a bad one is worse than a case without a verdict."""
    rank: int
    """Small is worse: a cell of several cases shows the worst."""
    color: str
    """Colour on pages, ``#RRGGBB``; colour-blind readers tell it from the others."""
    symbol: str
    """One character that says it without colour."""
    mark: str = ""
    """Mark in pictures of maps, whose fonts have letters alone."""
    passes: bool = False
    """Whether a case with it has passed."""
    conclusive: bool = True
    """Whether it counts where shares of failed runs are looked at."""
    level: Level = LEVEL_UNHURT
    """Order of verdicts that do not pass, for ``conductor compare``: 2 without a collision, 1 for
    one that was slowed down, 0 for the others and for what says nothing, as no verdict. One of a
    lower level is worse; those of one level are equal. All that pass are better."""


VERDICTS = (
    VerdictKind(name="pass", tone="good", rank=9, color="#0072B2", symbol="✓", passes=True),
    VerdictKind(
        name="false_braking", tone="doubtful", rank=8, color="#E69F00", symbol="◐", mark="!"
    ),
    VerdictKind(
        name="collision", tone="bad", rank=0, color="#D55E00", symbol="✕", mark="X", level=0
    ),
    VerdictKind(name="lane_departure", tone="bad", rank=1, color="#CC79A7", symbol="⇆", mark="<>"),
    VerdictKind(name="time_up", tone="doubtful", rank=7, color="#56B4E9", symbol="◷", mark="T"),
)
"""Verdicts of the shipped scenarios, in the order of reports."""

TRIAL_VERDICTS = (
    VerdictKind(name="avoided", tone="good", rank=10, color="#00598A", symbol="○", passes=True),
    VerdictKind(
        name="mitigated", tone="bad", rank=5, color="#F0C419", symbol="◑", mark="m", level=1
    ),
    VerdictKind(
        name="not_mitigated", tone="bad", rank=2, color="#A63A00", symbol="●", mark="N", level=0
    ),
    VerdictKind(name="fail", tone="bad", rank=3, color="#B5473C", symbol="✗", mark="x", level=0),
    VerdictKind(name="false_reaction", tone="bad", rank=4, color="#8A6200", symbol="↯", mark="R"),
    VerdictKind(
        name="inconclusive",
        tone="doubtful",
        rank=6,
        color="#9AA7B8",
        symbol="∅",
        mark="i",
        conclusive=False,
        level=0,
    ),
)
"""Verdicts of trials (:class:`schemas.sections.trial.Trial`), beside ``pass``."""
