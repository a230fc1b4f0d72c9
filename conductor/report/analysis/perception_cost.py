"""What perception cost in wall time, by model and by what ran it."""

from __future__ import annotations

from dataclasses import dataclass

from conductor.report.reading.dossier import CaseRow, Dossier
from conductor.report.reading.systems import system_name, system_text
from schemas.messages import PerceptionCost


@dataclass(frozen=True, slots=True)
class CostRow:
    """One line of the table; sums over the committed attempts of its cases."""

    model: str
    name: str
    """Name of the system under test on the page."""
    perception: str
    """What the perception really is."""
    runtime: str
    """Runtime that ran it."""
    cases: int
    frames: int
    frame_ms: float | None
    """Mean time per frame; frames that went together share theirs [ms]."""
    rig_share: float | None
    """Share of the wall time of all rigs of the campaign, 0 to 1: the lines add up."""
    stages_ms: dict[str, float]
    """Mean time per frame of what the stack does beside perception, by its names [ms]."""
    limited_s: dict[str, float]
    """Mean sim time per case during which something limited its sensors, by its words [s]."""


def perception_costs(dossier: Dossier) -> list[CostRow]:
    """Lines of the table in the order of the campaign; empty: no stack measured it."""
    groups: dict[tuple[str, str], list[tuple[CaseRow, PerceptionCost]]] = {}
    for row in dossier.rows:
        cost = row.end.perception
        if cost is not None:
            groups.setdefault((row.case.variation.model, cost.runtime), []).append((row, cost))
    rigs_s = sum(row.end.rig_wall_s for row in dossier.rows)
    return [_row(model, runtime, measured, rigs_s) for (model, runtime), measured in groups.items()]


def _row(
    model: str, runtime: str, measured: list[tuple[CaseRow, PerceptionCost]], rigs_s: float
) -> CostRow:
    frames = sum(cost.frames for _, cost in measured)
    wall_s = sum(cost.wall_s for _, cost in measured)
    return CostRow(
        model=model,
        name=system_name(measured[0][0].case),
        perception=system_text(measured[0][0].case),
        runtime=runtime,
        cases=len(measured),
        frames=frames,
        frame_ms=1e3 * wall_s / frames if frames else None,
        rig_share=wall_s / rigs_s if rigs_s > 0 else None,
        stages_ms=_means([cost.stages for _, cost in measured], 1e3, frames),
        limited_s=_means([cost.limited for _, cost in measured], 1.0, len(measured)),
    )


def _means(maps: list[dict[str, float]], scale: float, count: int) -> dict[str, float]:
    """Sum of each name over ``count``, in the order in which names come first."""
    sums: dict[str, float] = {}
    for one in maps:
        for name, value in one.items():
            sums[name] = sums.get(name, 0.0) + value
    return {name: scale * value / count for name, value in sums.items()} if count else {}
