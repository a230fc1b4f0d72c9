"""The cases one looks at first: false braking, the closest passes, the hardest impacts, the slowest
cases."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from conductor.report.analysis.losses import counts_by, extremes, page_axes
from conductor.report.reading.axes import axis_label, axis_values
from conductor.report.reading.dossier import CaseRow, Dossier

FALSE_BRAKING_MAX = 50
"""Most lines of the table of false braking, those that stopped furthest away."""
SLOWEST_MAX = 5


@dataclass(frozen=True, slots=True)
class Highlights:
    """Tables of single cases."""

    models: list[str]
    false_braking: list[tuple[CaseRow, float | None]]
    """Cases of false braking, each with the distance to the obstacle at which it came to rest, as
    its verdict says [m]; furthest first."""
    false_braking_more: int
    """Number of cases that are left out of ``false_braking``."""
    false_braking_by: list[tuple[str, list[tuple[Any, dict[str, str]]]]]
    """Counts of false braking by axis: per value and model how many of how many."""
    closest: list[CaseRow]
    """Cases that :attr:`schemas.kinds.scenario.ScenarioReport.extreme` is about."""
    hardest: list[CaseRow]
    slowest: list[CaseRow]
    """Cases that took the most wall time."""


def highlights(dossier: Dossier, rests_m: dict[str, list[float]]) -> Highlights:
    """The cases that stand out; ``rests_m`` says where each one came to rest [m]."""
    decided = [row for row in dossier.rows if row.passed is not None]
    unhurt = [row for row in decided if row.no_collision]
    braked = [
        (row, judged_rest_m(row, rests_m.get(row.case.id, [])))
        for row in decided
        if row.status == "false_braking"
    ]
    braked.sort(key=lambda pair: -(pair[1] or 0.0))
    by = [(axis_label(axis), counts_by(dossier, axis, "false_braking")) for axis in _axes(dossier)]
    extreme = dossier.scenario.report.extreme
    timed = [row for row in dossier.rows if row.end.attempt and row.end.wall_s > 0]
    return Highlights(
        models=[str(model) for model in axis_values(dossier, "model")],
        false_braking=braked[:FALSE_BRAKING_MAX],
        false_braking_more=max(0, len(braked) - FALSE_BRAKING_MAX),
        false_braking_by=[table for table in by if table[1]],
        closest=extremes(
            unhurt if extreme.of == "unhurt" else decided, extreme.scalar, largest=extreme.largest
        ),
        hardest=extremes(decided, "impact_speed_mps", largest=True),
        slowest=sorted(timed, key=lambda row: -row.end.wall_s)[:SLOWEST_MAX],
    )


def judged_rest_m(row: CaseRow, rests_m: list[float]) -> float | None:
    """The rest that the verdict false braking is about: the first one too far from the obstacle
    [m]; None: it is not known, or the verdict is another one."""
    if row.status != "false_braking":
        return None
    limit_m = row.case.variation.scenario.false_braking_m
    return next((dtc_m for dtc_m in rests_m if dtc_m > limit_m), None)


def _axes(dossier: Dossier) -> list[str]:
    return list(reversed(page_axes(dossier)))
