"""The cases one looks at first: false braking, the closest passes, the hardest impacts, the slowest
cases."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from conductor.report.axes import axis_label, axis_values
from conductor.report.dossier import Dossier, Row
from conductor.report.losses import counts_by, extremes, page_axes

FALSE_BRAKING_MAX = 50
"""Most lines of the table of false braking, those that stopped furthest away."""
SLOWEST_MAX = 5


@dataclass(frozen=True, slots=True)
class Highlights:
    """Tables of single cases."""

    models: list[str]
    false_braking: list[Row]
    """Furthest from the obstacle first."""
    false_braking_more: int
    """Cases that are left out of it."""
    false_braking_by: list[tuple[str, list[tuple[Any, dict[str, str]]]]]
    """By axis: per value and model how many of how many."""
    closest: list[Row]
    """Cases without a collision with the smallest distance to the obstacle; of lane keeping those
    furthest from the lane's centre."""
    hardest: list[Row]
    slowest: list[Row]
    """Cases that took the most wall time."""


def highlights(dossier: Dossier) -> Highlights:
    """Of the cases with a verdict."""
    decided = [row for row in dossier.rows if row.passed is not None]
    unhurt = [row for row in decided if row.no_collision]
    braked = [row for row in decided if row.status == "false_braking"]
    braked.sort(key=lambda row: -(row.scalar("dtc_end_m") or 0.0))
    by = [(axis_label(axis), counts_by(dossier, axis, "false_braking")) for axis in _axes(dossier)]
    closest = ("lateral_error_max_m", True) if dossier.lane_keeping else ("dtc_min_m", False)
    timed = [row for row in dossier.rows if row.end.attempt and row.end.wall_s > 0]
    return Highlights(
        models=[str(model) for model in axis_values(dossier, "model")],
        false_braking=braked[:FALSE_BRAKING_MAX],
        false_braking_more=max(0, len(braked) - FALSE_BRAKING_MAX),
        false_braking_by=[table for table in by if table[1]],
        closest=extremes(unhurt, closest[0], largest=closest[1]),
        hardest=extremes(decided, "impact_speed_mps", largest=True),
        slowest=sorted(timed, key=lambda row: -row.end.wall_s)[:SLOWEST_MAX],
    )


def _axes(dossier: Dossier) -> list[str]:
    return list(reversed(page_axes(dossier)))
