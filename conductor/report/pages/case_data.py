"""Every case as the page's script sees it: values of the axes, outcome, and what to say of it.

Columns instead of records: a campaign of ten thousand cases stays below two megabytes.
"""

from __future__ import annotations

import html
import math
from typing import Any, TypeGuard

from conductor.report.pages.tables import case_columns, statuses
from conductor.report.plots.cells import case_number, severity
from conductor.report.plots.palette import status_color, status_symbol
from conductor.report.reading.axes import axis_label, axis_value, axis_values, varied_axes
from conductor.report.reading.dossier import CaseRow, Dossier
from conductor.report.reading.systems import system_names
from schemas.kinds.scenario import kind_of

_REASONS, _REASON_CHARS = 2, 90
_MEASURES_MAX = 4


def map_axes(dossier: Dossier) -> list[str]:
    """Axes that maps and plots may be drawn over: the varied ones, and two in any case."""
    axes = varied_axes(dossier)
    return (
        axes
        + [a for a in ("time_of_day", "weather", "model") if a not in axes][: max(0, 2 - len(axes))]
    )


def case_data(dossier: Dossier) -> dict[str, Any]:
    """Columns over all cases in campaign order."""
    rows, known = dossier.rows, statuses(dossier)
    place = {status: number for number, status in enumerate(known)}
    axes = {axis: _axis(dossier, axis) for axis in map_axes(dossier)}
    return {
        "ids": [row.case.id for row in rows],
        "status": [place[row.status] for row in rows],
        "statuses": [
            {"name": status, "color": status_color(status), "symbol": status_symbol(status)}
            for status in known
        ],
        "passed": [-1 if row.passed is None else int(row.passed) for row in rows],
        "severity": [severity(row) for row in rows],
        "number": [case_number(row) for row in rows],
        "hover": [_hover(row) for row in rows],
        "axes": axes,
        "measures": _measures(dossier),
    }


def _axis(dossier: Dossier, axis: str) -> dict[str, Any]:
    values = axis_values(dossier, axis)
    names = system_names(dossier) if axis == "model" else {}
    place = {value: number for number, value in enumerate(values)}
    return {
        "label": axis_label(axis),
        "values": [names.get(value, str(value)) for value in values],
        "of": [place[axis_value(row.case, axis)] for row in dossier.rows],
    }


def _measures(dossier: Dossier) -> list[dict[str, Any]]:
    """Numbers whose medians can be drawn over the axes; those that some case has."""
    measures = []
    for label, name in case_columns(dossier):
        values = [row.scalar(name) for row in dossier.rows]
        if any(value is not None for value in values):
            plain = [float(f"{v:.4g}") if _is_number(v) else None for v in values]
            measures.append({"label": label, "values": plain})
    return measures[:_MEASURES_MAX]


def _is_number(value: float | int | None) -> TypeGuard[float | int]:
    return value is not None and math.isfinite(value)


def _hover(row: CaseRow) -> str:
    """Lines without the name; markup of Plotly's kind, so everything given is escaped."""
    lines = [html.escape(row.status.replace("_", " "), quote=False)]
    lead = kind_of(row.case.variation.scenario).report.lead
    value, speed = row.scalar(lead.scalar), row.scalar("impact_speed_mps")
    if value is not None:
        lines.append(lead.hover.format(value))
    if speed is not None:
        lines.append(f"impact at {speed:.2f} m/s")
    if not row.passed:
        for reason in row.end.reasons[:_REASONS]:
            short = reason if len(reason) <= _REASON_CHARS else reason[: _REASON_CHARS - 1] + "…"
            lines.append(html.escape(short, quote=False))
    return "<br>".join(lines)
