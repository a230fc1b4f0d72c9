"""``rulebook.json``: what a rulebook's runs came to, for other programs.

Speeds are relative to what the trial is about, in km/h, as test protocols have them.
"""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

from schemas.sections.rulebook import Axis, Rank

FILE_NAME = "rulebook.json"
NO_APPROVAL = "A simulation, and no type approval."
"""What stands on every page of a rulebook."""

Standing = Literal["passed", "failed", "open"]
"""``open``: a run has not ended, was lost, or is inconclusive."""


class RulebookRun(Struct, frozen=True, kw_only=True):
    """One run of a point."""

    case: str
    """Id of its case."""
    repetition: int
    status: str
    """Its verdict; without one how it ended, ``not ended`` before that."""
    passed: bool | None
    """None: it is not conclusive."""
    begin_kmh: float | None
    """Speed of the ego when the test began."""
    closing_kmh: float | None
    """Relative speed then."""
    impact_kmh: float | None
    """Relative impact speed; None: no contact that counts."""
    reduced_kmh: float | None
    """Speed of the ego when the test began less that at the impact."""
    warning_ttc_s: float | None
    warning_before_braking_s: float | None
    drawn: dict[str, float]
    """Axes of which this repetition has other values than its point, with its own."""
    reasons: list[str]
    """Reasons of the verdict."""


class RulebookPoint(Struct, frozen=True, kw_only=True):
    """Values of a row with the runs of them."""

    values: dict[str, Axis]
    """Numbers and axes of which the row or the matrix says something, as written there."""
    limit_kmh: float | None
    """Largest relative impact speed that passes; None: the criterion is another."""
    standing: Standing
    runs: list[RulebookRun]


class RulebookRowResult(Struct, frozen=True, kw_only=True):
    """One test."""

    row: str
    test: str
    clause: str
    rank: Rank
    """Rank of the source of its numbers. A: official text; B: text or files of a third party; C:
    somebody's reading."""
    rule: str
    """Rule of its trial: ``avoid``, ``limit``, ``no_reaction``, ``warn``."""
    note: str
    group: str
    standing: Standing
    points: list[RulebookPoint]


class RulebookCount(Struct, frozen=True, kw_only=True):
    """How many runs came to what."""

    runs: int
    passed: int
    failed: int
    inconclusive: int
    missing: int
    """Not ended, or lost."""

    @property
    def share(self) -> float | None:
        """Share of the conclusive runs that failed [-]; None: there is none."""
        conclusive = self.passed + self.failed
        return self.failed / conclusive if conclusive else None


class RulebookGroupResult(Struct, frozen=True, kw_only=True):
    """Rows that pass together."""

    group: str
    """Its name; empty: rows of no group."""
    title: str
    clause: str
    failures_max: float
    """Share of its conclusive runs that may fail [-]."""
    count: RulebookCount
    standing: Standing


class RulebookResult(Struct, frozen=True, kw_only=True):
    """The file."""

    schema: Literal[1] = 1
    title: str
    source: str
    rank: Rank
    note: str
    remark: str = NO_APPROVAL
    campaign: str
    digest: str
    """Digest of the campaign."""
    stack: str
    """Digest of the stack; empty: not known."""
    fingerprint: str
    """Fingerprint of the run; empty: it has none yet."""
    complete: bool
    partial: bool
    """Only some points of the rulebook were run, or some of its rows."""
    standing: Standing
    count: RulebookCount
    groups: list[RulebookGroupResult]
    rows: list[RulebookRowResult]
