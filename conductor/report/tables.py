"""The tables of the report as plain data: verdicts by system under test, cases, trouble."""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from typing import Any

from conductor.report.axes import axis_value, further_axes
from conductor.report.dossier import NOT_ENDED, Dossier, Row, perception_text
from schemas.kpi import SCALARS

KNOWN_STATUSES = (
    "pass",
    "false_braking",
    "collision",
    "failed",
    "unresolved",
    "cancelled",
    NOT_ENDED,
)
"""Statuses in the order of the report; verdicts that are new to it stand after ``collision``."""


@dataclass(frozen=True, slots=True)
class SystemRow:
    """One line of the verdict table: a system under test, or all of them."""

    model: str
    perception: str
    """What the perception really is."""
    batches: list[int]
    passed: int
    total: int
    counts: dict[str, int]
    """Status -> cases, in the order of :func:`statuses`; 0 where there is none."""
    stops_m: tuple[float, float, float] | None
    """Smallest, median and largest of the smallest distances of passed cases [m]."""

    @property
    def rate(self) -> float:
        """Passed cases of all cases, 0 to 1; a case without a verdict has not passed."""
        return self.passed / self.total


def statuses(dossier: Dossier) -> list[str]:
    """Statuses that occur, in the order of the report; ``pass`` and ``collision`` always."""
    found = {row.status for row in dossier.rows} | {"pass", "collision"}
    new = sorted(found - set(KNOWN_STATUSES))
    order = [*KNOWN_STATUSES[:3], *new, *KNOWN_STATUSES[3:]]
    return [status for status in order if status in found]


def verdict_table(dossier: Dossier) -> list[SystemRow]:
    """Like the paper's Table 1: one line per system under test, the sum of all last."""
    groups: dict[str, list[Row]] = {}
    for row in dossier.rows:
        groups.setdefault(row.case.model, []).append(row)
    lines = [
        _system(dossier, model, perception_text(rows[0].case), rows)
        for model, rows in groups.items()
    ]
    return [*lines, _system(dossier, "All", "", dossier.rows)]


def _system(dossier: Dossier, model: str, perception: str, rows: list[Row]) -> SystemRow:
    distances = [row.scalar("dtc_min_m") for row in rows if row.passed]
    known = [d for d in distances if d is not None]
    return SystemRow(
        model=model,
        perception=perception,
        batches=sorted({row.case.batch for row in rows if row.case.batch}),
        passed=sum(row.passed is True for row in rows),
        total=len(rows),
        counts={s: sum(row.status == s for row in rows) for s in statuses(dossier)},
        stops_m=(min(known), statistics.median(known), max(known)) if known else None,
    )


def case_record(dossier: Dossier, row: Row) -> dict[str, Any]:
    """One case as plain data: axes, outcome, scalars, origin; None where missing."""
    axes = ("model", "time_of_day", "weather", "repeat", "batch")
    end = row.end
    return {
        "case": row.case.id,
        **{axis: axis_value(row.case, axis) for axis in (*axes, *further_axes(dossier.campaign))},
        "perception": perception_text(row.case),
        "status": row.status,
        "outcome": end.outcome or None,
        "verdict": end.verdict or None,
        "passed": row.passed,
        "reasons": end.reasons,
        **{column.name: row.scalar(column.name) for column in SCALARS},
        "attempts": end.attempts,
        "charges": end.charges,
        "attempt_dir": end.attempt_dir or None,
        "kpi_sha256": end.kpi_sha256 or None,
        "device_class": end.device_class or None,
        "worker": end.worker or None,
        "wall_s": end.wall_s if end.attempt else None,
    }


def without_verdict(dossier: Dossier) -> list[Row]:
    """Cases that ended without a verdict."""
    return [row for row in dossier.rows if row.end.outcome not in ("", "verdict")]
