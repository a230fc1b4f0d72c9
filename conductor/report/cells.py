"""The cells of a heat map: cases by two axes, and what is said of those that share a cell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from conductor.report.axes import axis_value, axis_values
from conductor.report.dossier import Dossier, Row
from conductor.report.palette import status_symbol

# From bad to good: a cell of several cases shows the worst of them.
_WORST_FIRST = ("collision", "failed", "unresolved", "cancelled", "not ended")


@dataclass(frozen=True, slots=True)
class Cells:
    """Cases of one map; ``rows[y][x]``, empty where there is none."""

    xs: list[Any]
    ys: list[Any]
    rows: list[list[list[Row]]]


def cells_of(dossier: Dossier, rows: list[Row], x_axis: str, y_axis: str) -> Cells:
    """``rows`` by two axes, with all values that the campaign has."""
    xs, ys = axis_values(dossier, x_axis), axis_values(dossier, y_axis)
    found: dict[tuple[Any, Any], list[Row]] = {}
    for row in rows:
        key = (axis_value(row.case, x_axis), axis_value(row.case, y_axis))
        found.setdefault(key, []).append(row)
    return Cells(xs, ys, [[found.get((x, y), []) for x in xs] for y in ys])


def worst(cell: list[Row]) -> Row:
    """The case that a cell shows."""

    def severity(row: Row) -> int:
        if row.status in _WORST_FIRST:
            return _WORST_FIRST.index(row.status)
        return len(_WORST_FIRST) + (row.status == "pass") + (row.passed is True)

    return min(cell, key=severity)


def cell_text(cell: list[Row]) -> str:
    """Symbol and the number that matters: how near it came, or how hard it hit."""
    if not cell:
        return ""
    symbol = status_symbol(worst(cell).status)
    return f"{symbol} {cell_number(cell)}".rstrip()


def cell_number(cell: list[Row]) -> str:
    """Smallest distance [m], of a collision the impact speed [m/s]; of several cases how many
    passed. Empty: it is not known."""
    row = worst(cell)
    if len(cell) > 1:
        return f"{sum(r.passed is True for r in cell)}/{len(cell)}"
    if row.status == "collision":
        speed = row.scalar("impact_speed_mps")
        return "" if speed is None else f"{speed:.1f}"
    distance = row.scalar("dtc_min_m") if row.passed else None
    return "" if distance is None else f"{distance:.1f}"
