"""What a report's page shows of a rulebook."""

from __future__ import annotations

from dataclasses import dataclass

from msgspec import UNSET

from conductor.report.reading.axes import axis_label
from conductor.report.reading.dossier import Dossier
from conductor.report.rulebook.tables import GroupTable, group_tables
from schemas.files.rulebook_result import RulebookResult, RulebookRowResult, RulebookRun
from schemas.rulebook_rows import prefix_of

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
    """Runs that ended and did not pass."""


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
    )


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
