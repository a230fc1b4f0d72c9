"""The protocol's own tables: runs by two of a rulebook's numbers, or one row below the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from conductor.report.plots.palette import status_color, status_ink, status_symbol
from conductor.report.reading.axes import axis_label
from schemas.files.rulebook_result import (
    RulebookGroupResult,
    RulebookPoint,
    RulebookResult,
    RulebookRowResult,
    RulebookRun,
)
from schemas.kinds.scenario import verdict_kinds
from schemas.sections.rulebook import Rulebook

TEST = "test"
"""Axis of a table that stands for the tests of the rows."""
_RANKS = {kind.name: kind.rank for kind in verdict_kinds()}
_MISSING_RANK = -1
"""What has no verdict is shown before all that has one."""


@dataclass(frozen=True, slots=True)
class RulebookCell:
    """Runs of one cell; the worst of them gives colour and symbol."""

    runs: tuple[RulebookRun, ...]
    limit_kmh: float | None

    @property
    def worst(self) -> RulebookRun:
        """The worst run; of equal ones that with the fastest impact."""
        return min(
            self.runs,
            key=lambda run: (_RANKS.get(run.status, _MISSING_RANK), -(run.impact_kmh or 0.0)),
        )

    @property
    def status(self) -> str:
        """Status of the worst run."""
        return self.worst.status

    @property
    def color(self) -> str:
        """Fill."""
        return status_color(self.status)

    @property
    def ink(self) -> str:
        """Colour of the text on it."""
        return status_ink(self.status)

    @property
    def symbol(self) -> str:
        """What says the status without colour."""
        return status_symbol(self.status)

    @property
    def text(self) -> str:
        """Highest relative impact speed [km/h], and of several runs how many passed."""
        impacts = [run.impact_kmh for run in self.runs if run.impact_kmh is not None]
        parts = [f"{round(max(impacts))}"] if impacts else []  # no -0, of who walks into the ego
        if len(self.runs) > 1:
            parts.append(f"{sum(run.passed is True for run in self.runs)}/{len(self.runs)}")
        return " · ".join(parts)

    @property
    def title(self) -> str:
        """The runs in words."""
        lines = [
            f"{run.case}: {run.status.replace('_', ' ')}; {'; '.join(run.reasons)}"[:300]
            for run in self.runs[:6]
        ]
        more = len(self.runs) - len(lines)
        return "\n".join([*lines, *([f"and {more} more"] if more > 0 else [])])


@dataclass(frozen=True, slots=True)
class RulebookLine:
    """A line of a table: a label, and a cell for each column; None: the protocol has no such
    test."""

    label: str
    cells: tuple[RulebookCell | None, ...]


@dataclass(frozen=True, slots=True)
class GroupTable:
    """The table of one group."""

    group: RulebookGroupResult
    tests: tuple[str, ...]
    """Names of its tests."""
    x_label: str
    y_label: str
    columns: tuple[str, ...]
    lines: tuple[RulebookLine, ...]
    notes: tuple[str, ...]
    """Notes of its rows, each once."""


def group_tables(rulebook: Rulebook, result: RulebookResult) -> list[GroupTable]:
    """A table per group that was run, in the order of the rulebook."""
    return [_table(rulebook, result, group) for group in result.groups]


def _table(rulebook: Rulebook, result: RulebookResult, group: RulebookGroupResult) -> GroupTable:
    rows = [row for row in result.rows if row.group == group.group]
    declared = rulebook.groups.get(group.group)
    if declared is None or declared.table is None:
        x_label, y_label, columns, lines = _listed(rows)
    else:
        x_label, y_label, columns, lines = _gridded(rows, declared.table.x, declared.table.y)
    notes = dict.fromkeys(row.note for row in rows if row.note)
    return GroupTable(
        group=group,
        tests=tuple(dict.fromkeys(row.test for row in rows)),
        x_label=x_label,
        y_label=y_label,
        columns=columns,
        lines=lines,
        notes=tuple(notes),
    )


_Parts = tuple[str, str, tuple[str, ...], tuple[RulebookLine, ...]]


def _gridded(rows: Sequence[RulebookRowResult], x: str, y: str) -> _Parts:
    """Cells by two numbers or axes."""
    placed: dict[tuple[Any, Any], list[RulebookPoint]] = {}
    for row in rows:
        for point in row.points:
            placed.setdefault((_value(row, point, x), _value(row, point, y)), []).append(point)
    xs, ys = _ordered({key[0] for key in placed}), _ordered({key[1] for key in placed})
    if y == TEST:
        ys = list(dict.fromkeys(row.test for row in rows))
    if x == TEST:
        xs = list(dict.fromkeys(row.test for row in rows))
    lines = [
        RulebookLine(
            _said(down), tuple(_cell(placed[a, down]) if (a, down) in placed else None for a in xs)
        )
        for down in ys
    ]
    return _label(rows, x), _label(rows, y), tuple(map(_said, xs)), tuple(lines)


def _listed(rows: Sequence[RulebookRowResult]) -> _Parts:
    """A line per row, a column per point of it."""
    width = max(len(row.points) for row in rows)
    lines = []
    for row in rows:
        cells: list[RulebookCell | None] = [_cell([point]) for point in row.points]
        lines.append(RulebookLine(row.test, (*cells, *[None] * (width - len(cells)))))
    return "Point", "Test", tuple(str(i + 1) for i in range(width)), tuple(lines)


def _cell(points: Sequence[RulebookPoint]) -> RulebookCell:
    runs = tuple(run for point in points for run in point.runs)
    limits = {point.limit_kmh for point in points}
    return RulebookCell(runs, limits.pop() if len(limits) == 1 else None)


def _value(row: RulebookRowResult, point: RulebookPoint, axis: str) -> Any:
    """Value of a point on an axis of a table; numbers may be named without their prefix."""
    if axis == TEST:
        return row.test
    return point.values.get(_key(point, axis), "")


def _key(point: RulebookPoint, axis: str) -> str:
    return next((name for name in point.values if name == axis or name.endswith(f".{axis}")), axis)


def _label(rows: Sequence[RulebookRowResult], axis: str) -> str:
    if axis == TEST:
        return "Test"
    for row in rows:
        for point in row.points:
            if (key := _key(point, axis)) in point.values:
                return axis_label(key)
    return axis_label(axis)


def _ordered(values: set[Any]) -> list[Any]:
    """Numbers ascending, words after them."""
    return sorted(
        values, key=lambda v: (isinstance(v, str), v if not isinstance(v, str) else 0, str(v))
    )


def _said(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value).replace("_", " ") or "–"
