"""What each model loses: which cells, of which kind, and the cases that show it best."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import Any

from conductor.report.analysis.findings import AXIS_VALUES_MAX
from conductor.report.reading.axes import axis_value, axis_values, heat_axes
from conductor.report.reading.dossier import CaseRow, Dossier

EXAMPLES_MAX = 6
"""Cases of a model that are shown with a picture."""
BEFORE_END_S = 1.0
"""How long before the end one looks at a case without AEB [s]."""
EXTREMES_MAX = 5
"""Lines of a table of extremes."""


def lost(row: CaseRow) -> bool:
    """Whether a case ended otherwise than with a verdict that passes."""
    return not row.passed and bool(row.end.outcome)


def kind_of(row: CaseRow) -> str:
    """What kind of loss it is, for people."""
    words = row.status.replace("_", " ")
    if row.status != "collision":
        return words
    if not row.aeb_logged:
        return f"{words}, AEB not logged"
    return f"{words} in spite of AEB" if _triggered(row) else f"{words} without AEB"


def moment_of(row: CaseRow) -> str:
    """When to look, for ``viewer frame --at``: the AEB trigger, else a second before the end."""
    end_s = row.scalar("sim_time_s")
    if _triggered(row) or end_s is None:
        return "aeb"
    return f"{max(0.0, end_s - BEFORE_END_S):.3f}"


def _triggered(row: CaseRow) -> bool:
    return row.scalar("aeb_time_s") is not None


@dataclass(frozen=True, slots=True)
class LostLine:
    """The cells of one row of the heat map that a model loses."""

    value: Any
    """Value of the map's y axis, such as a weather."""
    cells: dict[str, list[str]]
    """Values of the x axis by status; with several cases in a cell how many of them."""


def lost_lines(dossier: Dossier, rows: list[CaseRow]) -> list[LostLine]:
    """What ``rows`` lose by the axes of the heat map, in its order; lines without a loss are left
    out."""
    x_axis, y_axis = page_axes(dossier)
    lines = []
    for y in axis_values(dossier, y_axis):
        line = [row for row in rows if axis_value(row.case, y_axis) == y]
        cells: dict[str, list[str]] = {}
        for x in axis_values(dossier, x_axis):
            cell = [row for row in line if axis_value(row.case, x_axis) == x]
            for status in dict.fromkeys(row.status for row in cell if lost(row)):
                count = sum(row.status == status for row in cell)
                many = f" ({count} of {len(cell)})" if len(cell) > 1 else ""
                cells.setdefault(status, []).append(f"{x}{many}")
        if cells:
            lines.append(LostLine(y, cells))
    return lines


def examples(dossier: Dossier, rows: list[CaseRow]) -> list[CaseRow]:
    """Lost cases, at most :data:`EXAMPLES_MAX`: kinds in turn, and of each kind other weathers (the
    map's y axis) first."""
    _, y_axis = page_axes(dossier)
    kinds: dict[str, list[CaseRow]] = {}
    for row in rows:
        if lost(row):
            kinds.setdefault(kind_of(row), []).append(row)
    queues = [_varied(group, y_axis) for _, group in sorted(kinds.items())]
    chosen: list[CaseRow] = []
    for turn in range(max(map(len, queues), default=0)):
        chosen += [queue[turn] for queue in queues if turn < len(queue)]
    return chosen[:EXAMPLES_MAX]


def _varied(rows: list[CaseRow], axis: str) -> list[CaseRow]:
    """Rows in turns: one of every value of the axis, then the second ones, and so on."""
    counts: dict[Any, int] = {}
    turns = []
    for row in rows:
        value = axis_value(row.case, axis)
        turns.append(counts.get(value, 0))
        counts[value] = turns[-1] + 1
    order = sorted(range(len(rows)), key=lambda i: (turns[i], i))
    return [rows[i] for i in order]


def page_axes(dossier: Dossier) -> tuple[str, str]:
    """The two axes (x, y) of the maps and tables of one model: as :func:`heat_axes`, but never the
    model itself."""
    named = [axis for axis in heat_axes(dossier) if axis != "model"]
    rest = [axis for axis in ("time_of_day", "weather") if axis not in named]
    if named == ["time_of_day"]:
        return "time_of_day", "weather"
    x, y = [*rest, *named][-2:] if len(named) < 2 else named
    return x, y


def extremes(rows: list[CaseRow], scalar: str, *, largest: bool) -> list[CaseRow]:
    """The cases with the largest or smallest values of a scalar KPI; ties in campaign order."""
    known = [(row.scalar(scalar), row) for row in rows]
    finite = [(value, row) for value, row in known if value is not None and math.isfinite(value)]
    finite.sort(key=lambda pair: -pair[0] if largest else pair[0])
    return [row for _, row in finite[:EXTREMES_MAX]]


def counts_by(dossier: Dossier, axis: str, status: str) -> list[tuple[Any, dict[str, str]]]:
    """Counts per value of ``axis`` and model: cases with ``status`` of all, as in ``2 of 8``;
    values of which no model has any are left out. Empty for an axis of too many values to be one of
    conditions."""
    values, models = axis_values(dossier, axis), axis_values(dossier, "model")
    if len(values) > AXIS_VALUES_MAX:
        return []
    total: Counter[tuple[Any, Any]] = Counter()
    hit: Counter[tuple[Any, Any]] = Counter()
    for row in dossier.rows:
        at = (axis_value(row.case, axis), row.case.variation.model)
        total[at] += 1
        hit[at] += row.status == status
    return [
        (
            value,
            {m: f"{hit[value, m]} of {n}" if (n := total[value, m]) else "–" for m in models},
        )
        for value in values
        if any(hit[value, model] for model in models)
    ]
