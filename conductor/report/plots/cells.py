"""The cells of a heat map: cases by two axes, and what is said of those that share a cell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from conductor.report.reading.axes import axis_value, axis_values
from conductor.report.reading.dossier import NOT_ENDED, CaseRow, Dossier
from schemas.kinds.scenario import kind_of, verdict_kinds

_OTHER = ""
# From bad to good: a cell of several cases shows the worst of them.
_VERDICTS = sorted(verdict_kinds(), key=lambda verdict: verdict.rank)
_WORST_FIRST = (
    *(verdict.name for verdict in _VERDICTS if verdict.tone == "bad"),
    *("failed", "unresolved", "cancelled", NOT_ENDED, _OTHER),
    *(verdict.name for verdict in _VERDICTS if verdict.tone != "bad"),
)


@dataclass(frozen=True, slots=True)
class Cells:
    """Cases of one map; ``rows[y][x]``, empty where there is none."""

    xs: list[Any]
    ys: list[Any]
    rows: list[list[list[CaseRow]]]


def cells_of(dossier: Dossier, rows: list[CaseRow], x_axis: str, y_axis: str) -> Cells:
    """``rows`` by two axes, with all values that the campaign has."""
    xs, ys = axis_values(dossier, x_axis), axis_values(dossier, y_axis)
    groups: dict[tuple[Any, Any], list[CaseRow]] = {}
    for row in rows:
        key = (axis_value(row.case, x_axis), axis_value(row.case, y_axis))
        groups.setdefault(key, []).append(row)
    return Cells(xs, ys, [[groups.get((x, y), []) for x in xs] for y in ys])


def severity(row: CaseRow) -> int:
    """Severity of a row's status; smaller is worse."""
    status = row.status if row.status in _WORST_FIRST else _OTHER
    return _WORST_FIRST.index(status)


def worst(cell: list[CaseRow]) -> CaseRow:
    """The case that a cell shows."""
    return min(cell, key=severity)


def cell_number(cell: list[CaseRow]) -> str:
    """Text beside the symbol: see :func:`case_number`; of several cases how many passed."""
    if len(cell) > 1:
        return f"{sum(r.passed is True for r in cell)}/{len(cell)}"
    return case_number(cell[0])


def case_number(row: CaseRow) -> str:
    """The scalar that its scenario leads with, of a collision the impact speed [m/s]. Empty: it is
    not known."""
    if row.status == "collision":
        speed = row.scalar("impact_speed_mps")
        return "" if speed is None else f"{speed:.1f}"
    lead = kind_of(row.case.variation.scenario).report.lead
    value = row.scalar(lead.scalar) if lead.of == "decided" or row.no_collision else None
    return "" if value is None else f"{value:.{lead.digits - 1}f}"
