"""Realtime: when a tick is due on the wall clock, and how old the command is that acts. Pure.

Times of the wall clock come in as arguments.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from schemas.wire.realtime import Realtime

BEHIND_S = 0.25
"""A case that fell behind the wall clock by more goes on from now, and does not catch up [s]."""

CSV_FILE = "realtime.csv"
"""File beside ``kpi.parquet`` with :data:`COLUMNS`."""

COLUMNS = ("tick", "late_ms", "command_age_ms", "new_command", "given_to_stack")
"""Columns of an attempt's table, a line per tick after the first."""


@dataclass(frozen=True, slots=True)
class Paced:
    """How an attempt went by the wall clock."""

    summary: Realtime
    table: str
    """Content of :data:`CSV_FILE`."""


@dataclass(slots=True)
class Pacer:
    """One case's ticks on the wall clock: tick n is due n periods after tick 0."""

    period_s: float
    begun_s: float
    """Tick 0 [s]."""
    overruns: int = 0
    slipped_s: float = 0.0
    """Wall time given up for good [s]."""

    def reach(self, tick: int, now_s: float) -> float:
        """``tick`` is next: how long until it is due; below 0: it is late, the one before has
        overrun [s]."""
        wait_s = self.begun_s + self.slipped_s + tick * self.period_s - now_s
        self.overruns += wait_s < 0.0
        if wait_s < -BEHIND_S:
            self.slipped_s -= wait_s
        return wait_s


@dataclass(slots=True)
class TickLog:
    """What happened at each tick after the first, which waits for the stack."""

    period_ns: int
    rows: list[tuple[int, float, float, bool, bool]] = field(default_factory=list)
    """Values of :data:`COLUMNS` by tick."""

    def add(self, tick: int, late_s: float, answered: int, *, new: bool, given: bool) -> None:
        """A tick began.

        Args:
            tick: its number.
            late_s: how long after its time [s].
            answered: tick of the oldest reading that the command in force answers.
            new: it acts for the first time.
            given: the stack got this tick's readings.
        """
        age_ms = (tick - answered) * self.period_ns / 1e6
        self.rows.append((tick, round(1e3 * late_s, 3), age_ms, new, given))

    def summary(self, pacer: Pacer, now_s: float) -> Realtime:
        """All of it so far; the last row's tick began at ``now_s``."""
        ages = sorted(row[2] for row in self.rows)
        ticks = len(self.rows)
        elapsed_s = now_s - pacer.begun_s
        return Realtime(
            ticks=ticks,
            overruns=pacer.overruns,
            dropped=sum(not row[4] for row in self.rows),
            age_p50_ms=_rank(ages, 0.5),
            age_p99_ms=_rank(ages, 0.99),
            age_max_ms=_rank(ages, 1.0),
            factor=ticks * pacer.period_s / elapsed_s if elapsed_s > 0.0 else 1.0,
        )

    def csv(self) -> str:
        """The rows as a table."""
        lines = [",".join(COLUMNS)]
        lines += [
            f"{t},{late:g},{age:g},{new:d},{sensed:d}" for t, late, age, new, sensed in self.rows
        ]
        return "\n".join(lines) + "\n"


def _rank(ordered: list[float], share: float) -> float | None:
    """The smallest value that ``share`` of all do not exceed."""
    if not ordered:
        return None
    return ordered[math.ceil(share * len(ordered)) - 1]
