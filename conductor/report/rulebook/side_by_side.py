"""The tables of a rulebook for two runs, in one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from conductor.report.reading.dossier import Dossier
from conductor.report.rulebook.results import rulebook_result
from conductor.report.rulebook.shown import RulebookShown, rulebook_shown
from conductor.report.rulebook.tables import GroupTable, RulebookCell

NOTHING = "–"
"""A cell that one of both runs does not have."""


@dataclass(frozen=True, slots=True)
class PairedTable:
    """Table of one group; cells are ``before → after``, or one text where both say the same."""

    title: str
    about: str
    """How the group stands in both."""
    columns: list[str]
    """Title of the lines, then those of the columns."""
    lines: list[list[str]]
    """Label, then cells."""


def paired_tables(before: Dossier, after: Dossier) -> list[PairedTable]:
    """A table per group that both runs have; none where one of them has no rulebook."""
    sides = [rulebook_shown(side, rulebook_result(side)) for side in (before, after)]
    if sides[0] is None or sides[1] is None:
        return []
    return [
        _paired(one, other)
        for one in sides[0].tables
        if (other := _same_group(sides[1], one)) is not None
    ]


def _same_group(shown: RulebookShown, table: GroupTable) -> GroupTable | None:
    return next((t for t in shown.tables if t.group.group == table.group.group), None)


def _paired(one: GroupTable, other: GroupTable) -> PairedTable:
    columns = _union(one.columns, other.columns)
    labels = _union([line.label for line in one.lines], [line.label for line in other.lines])
    lines = [
        [label, *(_said(_at(one, label, column), _at(other, label, column)) for column in columns)]
        for label in labels
    ]
    return PairedTable(
        title=one.group.title,
        about=f"{one.group.standing} before, {other.group.standing} after. "
        f"From left to right: {one.x_label}. Symbol of the worst run, highest relative impact "
        "speed [km/h], runs that passed.",
        columns=[one.y_label, *columns],
        lines=lines,
    )


def _union(one: Sequence[str], other: Sequence[str]) -> list[str]:
    return list(dict.fromkeys([*one, *other]))


def _at(table: GroupTable, label: str, column: str) -> RulebookCell | None:
    if column not in table.columns:
        return None
    at = table.columns.index(column)
    return next((line.cells[at] for line in table.lines if line.label == label), None)


def _said(one: RulebookCell | None, other: RulebookCell | None) -> str:
    texts = [
        NOTHING if cell is None else f"{cell.symbol} {cell.text}".strip() for cell in (one, other)
    ]
    if texts == [NOTHING, NOTHING]:
        return ""
    return texts[0] if texts[0] == texts[1] else " → ".join(texts)
