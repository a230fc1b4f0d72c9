"""What the runs of a rulebook came to: runs, points, rows and groups of a campaign's cases."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from msgspec import UNSET

from conductor.report.reading.axes import axis_value
from conductor.report.reading.dossier import CaseRow, Dossier
from schemas.files.rulebook_result import (
    RulebookCount,
    RulebookGroupResult,
    RulebookPoint,
    RulebookResult,
    RulebookRowResult,
    RulebookRun,
    Standing,
)
from schemas.kinds.scenario import trial_of, verdict_kinds
from schemas.rulebook_rows import axes_beyond, prefix_of
from schemas.sections.rulebook import Rulebook, RulebookGroup, RulebookRow
from schemas.sections.trial import Trial

_OTHERS = RulebookGroup(title="Other rows")
"""Rows without a group."""


def rulebook_result(dossier: Dossier, fingerprint: str = "") -> RulebookResult | None:
    """The result of a campaign's rulebook; None: it has none.

    Args:
        dossier: the campaign.
        fingerprint: of the run, if it has one.
    """
    rulebook = dossier.campaign.rulebook
    if rulebook is UNSET:
        return None
    prefix = prefix_of(dossier.campaign.scenario)
    by_row: dict[str, list[CaseRow]] = {row.row: [] for row in rulebook.rows}
    for case_row in dossier.rows:
        trial = _trial(case_row)
        if trial is not None and trial.row in by_row:
            by_row[trial.row].append(case_row)
    beyond = axes_beyond_of(dossier)
    rows = [
        _row(rulebook, row, by_row[row.row], _axes_of(row, prefix, beyond))
        for row in rulebook.rows
        if by_row[row.row]
    ]
    groups = _groups(rulebook, rows)
    runs = [run for row in rows for point in row.points for run in point.runs]
    return RulebookResult(
        title=rulebook.title,
        source=rulebook.source,
        rank=rulebook.rank,
        note=rulebook.note,
        campaign=dossier.outcomes.campaign,
        digest=dossier.outcomes.digest,
        stack=dossier.campaign.stack_identity.digest,
        fingerprint=fingerprint,
        complete=dossier.outcomes.complete,
        partial=bool(dossier.campaign.cases) or len(rows) < len(rulebook.rows),
        standing=_together(group.standing for group in groups),
        count=count_runs(runs),
        groups=groups,
        rows=rows,
    )


def axes_beyond_of(dossier: Dossier) -> list[str]:
    """Axes by which the cases of a campaign with a rulebook differ beside its rows."""
    campaign = dossier.campaign
    if campaign.rulebook is UNSET:
        return []
    return axes_beyond(campaign.rulebook, campaign.scenario, campaign.matrix, campaign.cases)


def _axes_of(row: RulebookRow, prefix: str, beyond: Sequence[str]) -> list[str]:
    """Axes that a row, or the matrix, says something of."""
    return [*dict.fromkeys([*(prefix + name for name in row.values), *row.conditions, *beyond])]


def _trial(case_row: CaseRow) -> Trial | None:
    trial: Trial | None = trial_of(case_row.case.variation.scenario)
    return trial


def _row(
    rulebook: Rulebook, row: RulebookRow, case_rows: Sequence[CaseRow], axes: Sequence[str]
) -> RulebookRowResult:
    points: dict[tuple[Any, ...], list[CaseRow]] = {}
    for case_row in case_rows:
        key = tuple(axis_value(case_row.case, axis) for axis in axes)
        points.setdefault(key, []).append(case_row)
    results = [
        _point(dict(zip(axes, key, strict=True)), members) for key, members in points.items()
    ]
    return RulebookRowResult(
        row=row.row,
        test=row.test,
        clause=row.clause,
        rank=row.rank or rulebook.rank,
        rule=row.trial.rule,
        note=row.note,
        group=row.group,
        standing=_together(point.standing for point in results),
        points=results,
    )


def _point(values: dict[str, Any], members: Sequence[CaseRow]) -> RulebookPoint:
    runs = [_run(case_row) for case_row in members]
    trial = _trial(members[0])
    count = count_runs(runs)
    return RulebookPoint(
        values=values,
        limit_kmh=trial.limit_kmh() if trial is not None and trial.rule == "limit" else None,
        standing=standing_of(count, 0.0),
        runs=runs,
    )


def _run(case_row: CaseRow) -> RulebookRun:
    trial = _trial(case_row)
    assert trial is not None
    case = case_row.case
    return RulebookRun(
        case=case.id,
        repetition=case.variation.repeat,
        status=case_row.status,
        passed=case_row.passed if _conclusive(case_row) else None,
        begin_kmh=_kmh(case_row, "trial_speed_mps"),
        closing_kmh=_kmh(case_row, "trial_closing_mps"),
        impact_kmh=_kmh(case_row, "impact_relative_mps"),
        reduced_kmh=_kmh(case_row, "speed_reduction_mps"),
        warning_ttc_s=case_row.scalar("warning_ttc_s"),
        warning_before_braking_s=case_row.scalar("warning_before_braking_s"),
        drawn={axis: _drawn(case_row, axis) for axis in trial.written},
        reasons=list(case_row.end.reasons),
    )


def _drawn(case_row: CaseRow, axis: str) -> float:
    """What a repetition has instead of what its row says."""
    value: float = axis_value(case_row.case, axis, drawn=True)
    return value


def _kmh(case_row: CaseRow, name: str) -> float | None:
    value = case_row.scalar(name)
    return None if value is None else value * 3.6


def _conclusive(case_row: CaseRow) -> bool:
    return case_row.passed is not None and case_row.status not in _INCONCLUSIVE


_INCONCLUSIVE = frozenset(kind.name for kind in verdict_kinds() if not kind.conclusive)


def count_runs(runs: Iterable[RulebookRun]) -> RulebookCount:
    """Count of runs by what they came to."""
    listed = list(runs)
    inconclusive = sum(run.status in _INCONCLUSIVE for run in listed)
    passed = sum(run.passed is True for run in listed)
    failed = sum(run.passed is False for run in listed)
    return RulebookCount(
        runs=len(listed),
        passed=passed,
        failed=failed,
        inconclusive=inconclusive,
        missing=len(listed) - passed - failed - inconclusive,
    )


def standing_of(count: RulebookCount, failures_max: float) -> Standing:
    """Whether runs of which a share may fail pass together. More failures than even all runs would
    allow have failed; else a run that is missing or inconclusive leaves it open."""
    undecided = count.inconclusive + count.missing
    allowed = failures_max * count.runs
    if count.failed > allowed + 1e-9:
        return "failed"
    if undecided or not count.runs:
        return "open"
    return "passed"


def _together(standings: Iterable[Standing]) -> Standing:
    listed = set(standings)
    if "failed" in listed:
        return "failed"
    return "passed" if listed == {"passed"} else "open"


def _groups(rulebook: Rulebook, rows: Sequence[RulebookRowResult]) -> list[RulebookGroupResult]:
    """Groups in the order of the rulebook; rows of none come last."""
    results = []
    for name, group in (*rulebook.groups.items(), ("", _OTHERS)):
        members = [row for row in rows if row.group == name]
        if not members:
            continue
        count = count_runs(r for row in members for point in row.points for r in point.runs)
        results.append(
            RulebookGroupResult(
                group=name,
                title=group.title,
                clause=group.clause,
                failures_max=group.failures_max,
                count=count,
                standing=standing_of(count, group.failures_max),
            )
        )
    return results
