"""What changed between two runs of the same cases: pure, from two dossiers.

Cases are paired by id. Differences are always the second run less the first one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from conductor.records.fingerprint import Fingerprint
from conductor.report.analysis.findings import AXIS_VALUES_MAX
from conductor.report.analysis.statistics import (
    Interval,
    holm,
    mcnemar,
    mean_interval,
    median_interval,
    newcombe_paired,
)
from conductor.report.reading.axes import axis_label, axis_value, axis_values, varied_axes
from conductor.report.reading.dossier import CaseRow, Dossier
from conductor.report.rulebook.side_by_side import PairedTable, paired_tables
from schemas.case import Case
from schemas.identity import scenario_by_content
from schemas.kinds.kpi import KpiKind, scalars_by_name
from schemas.kinds.scenario import levels_of_verdicts
from schemas.kinds.verdict import LEVEL_UNHURT
from schemas.sections.stack_identity import difference
from twin.base.errors import UsageError

Change = Literal["worse", "better", "other"]

_SETTINGS: tuple[tuple[str, Callable[[Case], Any]], ...] = (
    ("seed", lambda case: case.variation.seed),
    ("scenario", lambda case: scenario_by_content(case)),
    ("control_hz", lambda case: case.rig.control_hz),
    ("camera", lambda case: (case.rig.camera, case.rig.cameras, case.rig.render)),
    ("lidars", lambda case: case.rig.lidars),
    ("sensors", lambda case: case.variation.sensors),
    (
        "environment",
        lambda case: (
            case.variation.environment,
            case.variation.weather,
            case.variation.time_of_day_min,
        ),
    ),
    ("autonomy.latency_ms", lambda case: case.variation.latency_ms),
    ("clock", lambda case: case.rig.clock),
    ("autonomy.tell", lambda case: case.variation.tell),
)
"""What the test is, as opposed to what is tested: it should be the same in both runs."""


@dataclass(frozen=True, slots=True)
class Side:
    """One of the two runs."""

    folder: str
    """Last part of its path."""
    campaign: str
    cases: int
    passed: int
    no_collision: int
    fingerprint: str
    software: str | None
    """Software digest; None: nothing was run here."""
    stack: str | None
    """Digest of the stack; empty: a shipped one, or not known; None: nothing was run here."""
    device_classes: list[str] | None
    """Device classes; None: nothing was run here."""


@dataclass(frozen=True, slots=True)
class Flip:
    """A case whose status changed."""

    case: str
    before: str
    after: str
    change: Change
    reasons: list[str]
    """Reasons of the second run."""


@dataclass(frozen=True, slots=True)
class Shift:
    """A scalar KPI over the pairs that have it in both runs."""

    name: str
    label: str
    pairs: int
    changed: int
    median: Interval | None
    """Median of the differences; the bounds are infinite for fewer than six pairs."""
    mean: Interval | None
    """Mean of the differences: moved by a few large ones, which the median is not."""
    largest_case: str
    """Case where the difference is largest; empty: nothing changed."""
    largest: float | None
    lost: int
    """Pairs that have it in the first run only."""
    gained: int
    """Pairs that have it in the second run only."""


@dataclass(frozen=True, slots=True)
class AxisLine:
    """Pairs with one value of an axis."""

    axis: str
    label: str
    value: str
    pairs: int
    passed_before: int
    passed_after: int
    difference: Interval
    """Difference of the shares that passed."""
    p_value: float
    """McNemar's exact test, corrected for all lines."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Changes between two runs."""

    before: Side
    after: Side
    identical: bool
    """The fingerprints are equal, so every outcome, verdict and KPI value of every case is, to the
    last bit."""
    pairs: int
    same_bytes: int
    """Pairs with equal KPI values, to the last bit."""
    only_before: list[str]
    only_after: list[str]
    flips: list[Flip]
    lost: int
    """Pairs that passed in the first run only."""
    won: int
    """Pairs that passed in the second run only."""
    passed_before: int
    """Pairs that passed in the first run."""
    passed_after: int
    p_value: float
    difference: Interval
    axes: list[AxisLine]
    shifts: list[Shift]
    notes: list[str]
    """What makes the comparison less than one of two versions under the same conditions."""
    rulebook: list[PairedTable]
    """Tables of the rulebook that both have run."""

    @property
    def regressions(self) -> list[Flip]:
        """Cases that have become worse: one is a regression."""
        return [flip for flip in self.flips if flip.change == "worse"]


def compare(
    before: Dossier, after: Dossier, before_found: Fingerprint, after_found: Fingerprint
) -> Comparison:
    """Compare two finished runs.

    Raises:
        UsageError: they cannot be compared.
    """
    pairs = _pairs(before, after)
    counts = _counts([(a.passed is True, b.passed is True) for a, b in pairs])
    both, won, lost, _ = counts
    flips = [_flip(a, b) for a, b in pairs if a.status != b.status]
    here, there = ({row.case.id for row in dossier.rows} for dossier in (before, after))
    identical = before_found.sha256 == after_found.sha256
    return Comparison(
        before=_side(before, before_found),
        after=_side(after, after_found),
        identical=identical,
        pairs=len(pairs),
        same_bytes=sum(_same_bytes(a, b) for a, b in pairs),
        only_before=[row.case.id for row in before.rows if row.case.id not in there],
        only_after=[row.case.id for row in after.rows if row.case.id not in here],
        flips=sorted(flips, key=lambda flip: ("worse", "better", "other").index(flip.change)),
        lost=lost,
        won=won,
        passed_before=both + lost,
        passed_after=both + won,
        p_value=mcnemar(won, lost),
        difference=newcombe_paired(*counts),
        axes=_axes(before, pairs),
        shifts=[shift for kind in _compared(before) if (shift := _shift(kind, pairs))],
        notes=_notes(before, after, pairs, identical=identical),
        rulebook=paired_tables(before, after),
    )


def level_of(row: CaseRow) -> int:
    """How good a case's end is, as the table of verdicts says; 0 without a verdict, unless the
    complete log of an imported case tells of no collision."""
    if row.end.outcome == "verdict":
        return levels_of_verdicts().get(row.end.verdict, 0)
    return LEVEL_UNHURT if row.no_collision is True else 0


def _pairs(before: Dossier, after: Dossier) -> list[tuple[CaseRow, CaseRow]]:
    for dossier in (before, after):
        if not dossier.rows:
            raise UsageError(f"{dossier.folder}: has no cases")
    kinds = [dossier.campaign.scenario.type for dossier in (before, after)]
    if kinds[0] != kinds[1]:
        raise UsageError(
            f"{before.folder} is about {kinds[0]} and {after.folder} about {kinds[1]}: passing "
            "does not mean the same in both; compare runs of the same scenario"
        )
    there = {row.case.id: row for row in after.rows}
    pairs = [(row, there[row.case.id]) for row in before.rows if row.case.id in there]
    if not pairs:
        raise UsageError(
            f"{before.folder} and {after.folder}: no case id in common, e.g. "
            f"'{before.rows[0].case.id}' and '{after.rows[0].case.id}'; compare runs of the same "
            "campaign file"
        )
    return pairs


def _side(dossier: Dossier, fingerprint: Fingerprint) -> Side:
    outcomes = dossier.outcomes
    return Side(
        folder=dossier.folder.absolute().name,
        campaign=outcomes.campaign,
        cases=len(dossier.rows),
        passed=dossier.passed,
        no_collision=dossier.no_collision,
        fingerprint=fingerprint.sha256,
        software=outcomes.software or None,
        stack=None if dossier.imported else dossier.campaign.stack_identity.digest,
        device_classes=None if dossier.imported else outcomes.device_classes,
    )


def _counts(passed: Sequence[tuple[bool, bool]]) -> tuple[int, int, int, int]:
    """Counts of both, second only, first only, neither: the second run is what is looked at."""
    return (
        sum(a and b for a, b in passed),
        sum(b and not a for a, b in passed),
        sum(a and not b for a, b in passed),
        sum(not a and not b for a, b in passed),
    )


def _flip(a: CaseRow, b: CaseRow) -> Flip:
    step = level_of(b) - level_of(a)
    change: Change = "worse" if step < 0 else "better" if step > 0 else "other"
    return Flip(a.case.id, a.status, b.status, change, b.end.reasons)


def _same_bytes(a: CaseRow, b: CaseRow) -> bool:
    same_end = (a.end.outcome, a.end.verdict) == (b.end.outcome, b.end.verdict)
    return same_end and a.end.kpi_sha256 == b.end.kpi_sha256


def _axes(dossier: Dossier, pairs: list[tuple[CaseRow, CaseRow]]) -> list[AxisLine]:
    """One line per value of every axis of the first run."""
    rows: list[tuple[str, Any, tuple[int, int, int, int]]] = []
    for axis in varied_axes(dossier):
        values = axis_values(dossier, axis)
        if len(values) > AXIS_VALUES_MAX:
            continue
        groups: dict[Any, list[tuple[bool, bool]]] = {value: [] for value in values}
        for a, b in pairs:
            groups[axis_value(a.case, axis)].append((a.passed is True, b.passed is True))
        rows += [(axis, value, _counts(group)) for value, group in groups.items() if group]
    corrected = holm([mcnemar(won, lost) for _, _, (_, won, lost, _) in rows])
    return [
        AxisLine(
            axis=axis,
            label=axis_label(axis),
            value=str(value),
            pairs=sum(counts),
            passed_before=counts[0] + counts[2],
            passed_after=counts[0] + counts[1],
            difference=newcombe_paired(*counts),
            p_value=p_value,
        )
        for (axis, value, counts), p_value in zip(rows, corrected, strict=True)
    ]


def _compared(dossier: Dossier) -> list[KpiKind]:
    """Scalars that are compared: those of the scenario's case table first, in its order."""
    table = dossier.scenario.report.table
    compared = [kind for kind in scalars_by_name().values() if kind.compared]
    return sorted(compared, key=lambda k: table.index(k.name) if k.name in table else len(table))


def _shift(kind: KpiKind, pairs: list[tuple[CaseRow, CaseRow]]) -> Shift | None:
    """Shift of a KPI; None: neither run has it anywhere."""
    lost = gained = 0
    name, known = kind.name, list[tuple[float, str]]()
    for a, b in pairs:
        first, second = _finite(a, name), _finite(b, name)
        if first is not None and second is not None:
            known.append((second - first, a.case.id))
        lost += first is not None and second is None
        gained += first is None and second is not None
    if not known and not lost and not gained:
        return None
    differences = [difference for difference, _ in known]
    changed = [pair for pair in known if pair[0] != 0.0]
    largest, case = max(changed, key=lambda pair: abs(pair[0]), default=(None, ""))
    return Shift(
        name=name,
        label=kind.compared,
        pairs=len(known),
        changed=len(changed),
        median=median_interval(differences),
        mean=mean_interval(differences),
        largest_case=case,
        largest=largest,
        lost=lost,
        gained=gained,
    )


def _finite(row: CaseRow, name: str) -> float | None:
    value = row.scalar(name)
    return None if value is None or not math.isfinite(value) else float(value)


def _notes(
    before: Dossier, after: Dossier, pairs: list[tuple[CaseRow, CaseRow]], *, identical: bool
) -> list[str]:
    logs = [dossier.folder.absolute().name for dossier in (before, after) if dossier.imported]
    if logs:
        return [
            f"imported from logs: {', '.join(logs)}; whether both ran under the same conditions is "
            "not in them"
        ]
    notes = []
    if "realtime" in (before.outcomes.clock, after.outcomes.clock):
        notes.append(
            "clock realtime: a case may end otherwise in another run of the same stack; one flip "
            "says little"
        )
    for name, setting in _SETTINGS:
        differing = sum(setting(a.case) != setting(b.case) for a, b in pairs)
        if differing:
            notes.append(
                f"'{name}' differs in {differing} of {len(pairs)} pairs: they were not run under "
                "the same conditions"
            )
    one, two = before.outcomes, after.outcomes
    stacks = (before.campaign.stack_identity, after.campaign.stack_identity)
    if what := difference(*stacks):
        notes.append(
            f"the stack is another: {what} (stack digest {stacks[0].digest[:12] or 'none'} before, "
            f"{stacks[1].digest[:12] or 'none'} after)"
        )
    if one.device_classes != two.device_classes:
        shown = [", ".join(run.device_classes) or "none" for run in (one, two)]
        notes.append(f"device classes differ ({shown[0]}; {shown[1]}): so may the last bits")
    elif one.software and (one.software, one.digest) == (two.software, two.digest):
        if not identical and len(one.device_classes) == 1 and one.clock == "lockstep":
            notes.append(
                "software, campaign and device class are the same and the results are not: "
                "what the stack reads has changed, or it is not deterministic"
            )
    elif one.software and one.software == two.software and not what:
        notes.append("the software is the same; only the campaign differs")
    return notes
