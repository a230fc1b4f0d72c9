"""The tables of the report as plain data: verdicts by system under test, cases, trouble."""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from typing import Any

import msgspec

from conductor.report.analysis.statistics import wilson
from conductor.report.reading.axes import axis_label, axis_value, further_axes, varied_axes
from conductor.report.reading.curves import time_label
from conductor.report.reading.dossier import NOT_ENDED, CaseRow, Dossier
from conductor.report.reading.systems import system_name, system_text
from schemas.files.kpi import NAMES
from schemas.kinds.kpi import scalars_by_name
from schemas.kinds.kpis.formula import KPIS as OF_FORMULA
from schemas.kinds.scenario import verdict_kinds

KNOWN_STATUSES = (
    *(verdict.name for verdict in verdict_kinds()),
    *("failed", "unresolved", "cancelled", NOT_ENDED),
)
"""Statuses in the order of the report; verdicts that nobody declares stand after the others."""

_VERDICTS = KNOWN_STATUSES.index("failed")


@dataclass(frozen=True, slots=True)
class SystemRow:
    """One line of the verdict table: a system under test, or all of them."""

    model: str
    name: str
    """Name on the page, see :func:`conductor.report.reading.systems.system_name`."""
    perception: str
    """What the system really is: its perception, or whose stack it is."""
    batches: list[int]
    passed: int
    """Cases with the verdict ``pass``."""
    no_collision: int
    """Cases with a verdict in which the ego did not collide: the rule of the AutoDRIVE paper."""
    total: int
    counts: dict[str, int]
    """Status -> cases, in the order of :func:`statuses`; 0 where there is none."""
    stops_m: tuple[float, float, float] | None
    """Smallest, median and largest of the smallest distances of cases without a collision [m]."""
    lead: tuple[float, float, float] | None
    """Smallest, median and largest value of the scalar that the scenario leads with."""
    lateral_rms_m: tuple[float, float, float] | None
    """Smallest, median and largest lateral error (RMS) of decided cases; lane keeping [m]."""

    @property
    def rate(self) -> float:
        """Passed cases of all cases, 0 to 1; a case without a verdict has not passed."""
        return self.passed / self.total

    @property
    def interval(self) -> tuple[float, float] | None:
        """Wilson's interval at 95 % of the share of passed in ended cases, 0 to 1; None: none has
        ended."""
        ended = self.total - self.counts.get(NOT_ENDED, 0)
        return wilson(self.passed, ended) if ended else None


def statuses(dossier: Dossier) -> list[str]:
    """Statuses that occur, in the order of the report; ``pass`` and ``collision`` always."""
    occurring = {row.status for row in dossier.rows} | {"pass", "collision"}
    new = sorted(occurring - set(KNOWN_STATUSES))
    order = [*KNOWN_STATUSES[:_VERDICTS], *new, *KNOWN_STATUSES[_VERDICTS:]]
    return [status for status in order if status in occurring]


def verdict_table(dossier: Dossier) -> list[SystemRow]:
    """Like the paper's Table 1: one line per system under test, the sum of all last."""
    groups: dict[str, list[CaseRow]] = {}
    for row in dossier.rows:
        groups.setdefault(row.case.variation.model, []).append(row)
    lines = [_system(dossier, model, rows) for model, rows in groups.items()]
    return [*lines, _system(dossier, "All", dossier.rows)]


def _system(dossier: Dossier, model: str, rows: list[CaseRow]) -> SystemRow:
    everyone = rows is dossier.rows
    return SystemRow(
        model=model,
        name=model if everyone else system_name(rows[0].case),
        perception="" if everyone else system_text(rows[0].case),
        batches=sorted({row.case.variation.batch for row in rows if row.case.variation.batch}),
        passed=sum(row.passed is True for row in rows),
        no_collision=sum(row.no_collision is True for row in rows),
        total=len(rows),
        counts={s: sum(row.status == s for row in rows) for s in statuses(dossier)},
        lead=_lead(dossier, rows),
        stops_m=_spread([row.scalar("dtc_min_m") for row in rows if row.no_collision]),
        lateral_rms_m=_spread(
            [row.scalar("lateral_error_rms_m") for row in rows if row.passed is not None]
        ),
    )


def _lead(dossier: Dossier, rows: list[CaseRow]) -> tuple[float, float, float] | None:
    lead = dossier.scenario.report.lead
    if lead.of == "unhurt":
        counted = [row for row in rows if row.no_collision]
    else:
        counted = [row for row in rows if row.passed is not None]
    return _spread([row.scalar(lead.scalar) for row in counted])


def _spread(values: list[float | int | None]) -> tuple[float, float, float] | None:
    known = [value for value in values if value is not None]
    return (min(known), statistics.median(known), max(known)) if known else None


def case_columns(dossier: Dossier) -> list[tuple[str, str]]:
    """Title and scalar of the numbers that the case table may have."""
    known = scalars_by_name()
    labels = {name: known[name].label for name in dossier.scenario.report.table}
    return [
        (time_label(dossier) if name == "sim_time_s" else label, name)
        for name, label in labels.items()
    ]


def case_axes(dossier: Dossier) -> list[tuple[str, str]]:
    """Axes of the case table with their titles, those that vary first."""
    plain = [("model", "Model"), ("weather", "Weather"), ("time_of_day", "Time of day")]
    further = [(axis, axis_label(axis)) for axis in further_axes(dossier.campaign)]
    varied = varied_axes(dossier)
    return sorted([*plain, *further], key=lambda axis: axis[0] not in varied)


def case_record(dossier: Dossier, row: CaseRow) -> dict[str, Any]:
    """One case as plain data: axes, outcome, scalars, origin; None where missing."""
    axes = ("model", "time_of_day", "weather", "repeat", "batch")
    end = row.end
    return {
        "case": row.case.id,
        **{axis: axis_value(row.case, axis) for axis in (*axes, *further_axes(dossier.campaign))},
        "perception": system_text(row.case),
        "status": row.status,
        "outcome": end.outcome or None,
        "verdict": end.verdict or None,
        "passed": row.passed,
        "no_collision": row.no_collision,
        "reasons": end.reasons,
        **{column.name: row.scalar(column.name) for column in dossier.scenario.scalars},
        **{k.name: row.scalar(k.name) for k in OF_FORMULA if k.name in end.scalars},
        **{column.name: row.end.names.get(column.name) for column in NAMES},
        "realtime": msgspec.to_builtins(end.realtime),
        "attempts": end.attempts if dossier.imported is None else None,
        "charges": end.charges,
        "attempt_dir": end.attempt_dir or None,
        "kpi_sha256": end.kpi_sha256 or None,
        "device_class": end.device_class or None,
        "worker": end.worker or None,
        "wall_s": end.wall_s if end.attempt else None,
    }


def without_verdict(dossier: Dossier) -> list[CaseRow]:
    """Cases that ended without a verdict."""
    return [row for row in dossier.rows if row.end.outcome not in ("", "verdict")]
