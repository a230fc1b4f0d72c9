"""What a report's page shows of a rulebook."""

from __future__ import annotations

from dataclasses import dataclass

from msgspec import UNSET

from conductor.report.reading.axes import axis_label
from conductor.report.reading.dossier import Dossier
from conductor.report.rulebook.results import axes_beyond_of
from conductor.report.rulebook.tables import GroupTable, group_tables
from schemas.files.rulebook_result import RulebookResult, RulebookRowResult, RulebookRun
from schemas.rulebook_rows import prefix_of
from schemas.sections.rulebook import Axis

RULE = (
    "Passed means: the run fulfils the criterion of its row (verdict pass or avoided). A run that "
    "missed a precondition is inconclusive: it counts neither as passed nor as failed, and leaves "
    "its row open."
)
"""What passing means."""
_SECOND_HAND = {
    "B": "text or files of a third party",
    "C": "somebody's reading of the source",
}


@dataclass(frozen=True, slots=True)
class BeyondTable:
    """Passed runs by the values of an axis that the rulebook leaves to the matrix, as weathers."""

    label: str
    columns: list[str]
    """Titles of the groups."""
    lines: list[tuple[str, list[str]]]
    """Value of the axis, then of each group and of all ``passed/runs``."""


@dataclass(frozen=True, slots=True)
class RulebookShown:
    """A result with its tables and its losses."""

    result: RulebookResult
    tables: list[GroupTable]
    second_hand: str
    """Which figures are second-hand."""
    varied: str
    """In what repetitions differ beside noise; empty: in nothing."""
    told: list[str]
    """Statuses of its runs, each once."""
    lost: list[tuple[RulebookRowResult, RulebookRun]]
    """Runs that did not pass."""
    beyond: list[BeyondTable]
    """A table for each axis of the matrix with several values."""

    @property
    def clauses(self) -> bool:
        """Whether the source of any group has a clause."""
        return any(group.clause for group in self.result.groups)

    @property
    def worst_lost(self) -> list[str]:
        """Cases of the worst run of each cell in which not all passed."""
        cells = [cell for t in self.tables for line in t.lines for cell in line.cells if cell]
        return [cell.worst.case for cell in cells if cell.worst.passed is not True]


def rulebook_shown(dossier: Dossier, result: RulebookResult | None) -> RulebookShown | None:
    """What is shown of a result; None: there is none."""
    rulebook = dossier.campaign.rulebook
    if result is None or rulebook is UNSET:
        return None
    runs = [(row, run) for row in result.rows for p in row.points for run in p.runs]
    prefix = prefix_of(dossier.campaign.scenario)
    varied = dict.fromkeys(
        axis_label(prefix + name if name in row.values else name)
        for row in rulebook.rows
        for name in row.varied
    )
    return RulebookShown(
        result=result,
        tables=group_tables(rulebook, result),
        second_hand=second_hand(result),
        varied=", ".join(varied) if any(row.repetitions > 1 for row in rulebook.rows) else "",
        told=sorted({run.status for _, run in runs}),
        lost=[(row, run) for row, run in runs if run.passed is not True],
        beyond=[t for axis in axes_beyond_of(dossier) if (t := _beyond(result, axis))],
    )


def _beyond(result: RulebookResult, axis: str) -> BeyondTable | None:
    """The table of an axis; None: it has one value."""
    points = [(row.group, point) for row in result.rows for point in row.points]
    values = list(dict.fromkeys(point.values[axis] for _, point in points))
    if len(values) < 2:
        return None
    groups = [group.group for group in result.groups]

    def passed(value: Axis, names: list[str]) -> str:
        runs = [
            run
            for name, point in points
            if name in names and point.values[axis] == value
            for run in point.runs
        ]
        return f"{sum(run.passed is True for run in runs)}/{len(runs)}" if runs else "–"

    lines = [
        (
            str(value).replace("_", " "),
            [*(passed(value, [name]) for name in groups), passed(value, groups)],
        )
        for value in values
    ]
    return BeyondTable(axis_label(axis), [group.title for group in result.groups], lines)


def second_hand(result: RulebookResult) -> str:
    """A sentence about figures that are not from an official text, with the tests they are of."""
    sentences = []
    for rank, words in _SECOND_HAND.items():
        tests = dict.fromkeys(row.test for row in result.rows if row.rank == rank)
        if not tests:
            continue
        every = len(tests) == len({row.test for row in result.rows})
        of = "all tests" if every else ", ".join(tests)
        sentences.append(f"Figures of {of} are second-hand (rank {rank}: {words}).")
    return " ".join(sentences)
