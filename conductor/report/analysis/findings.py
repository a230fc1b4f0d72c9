"""What a campaign shows, in plain sentences: each with the numbers and the test behind it.

Sentences are plain text; whoever writes them into a page escapes them. They follow from verdicts
and scalars alone. In a full matrix every value of an axis meets the same values of all others, so
an axis may be tested by itself; in a list of single cases its effect may be that of another axis.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from conductor.report.analysis.statistics import (
    ALPHA,
    Homogeneity,
    holm,
    homogeneity,
    mcnemar,
    newcombe_paired,
    wilson,
)
from conductor.report.reading.axes import axis_label, axis_value, axis_values, varied_axes
from conductor.report.reading.dossier import CaseRow, Dossier
from conductor.report.reading.systems import system_names
from schemas.words import agree, counted

EARLY = 2.0
"""A first AEB trigger further from the obstacle than so many times ``scenario.false_braking_m``
answers to something else."""
AXIS_VALUES_MAX = 64
"""An axis with more values is no axis of conditions, and is not tested."""
SYSTEMS_MAX = 12
"""Most systems under test that are compared pair by pair."""

Kind = Literal["passed", "systems", "axis", "hidden", "early", "collision", "missing"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One sentence."""

    kind: Kind
    text: str
    p_value: float | None = None
    """P-value of the test behind it, corrected for the number of such tests; None: no test."""
    cases: tuple[str, ...] = ()
    """Ids of the cases it speaks of, in campaign order."""


def findings(dossier: Dossier) -> list[Finding]:
    """Every finding, those about the whole campaign first. While cases are left, shares of all
    cases would say too little."""
    rows = dossier.rows
    return [
        *_missing(dossier),
        *(_passed(dossier) if dossier.outcomes.complete else []),
        *_systems(dossier),
        *_axes(dossier),
        *_hidden(dossier),
        *_collisions(rows),
    ]


def percent(share: float) -> str:
    """A share for people."""
    return f"{100 * share:.1f} %"


def points(difference: float) -> str:
    """A difference of shares for people, in percentage points."""
    return f"{100 * difference:.1f}"


def p_text(p_value: float) -> str:
    """A p-value for people."""
    return "p < 0.001" if p_value < 0.001 else f"p = {p_value:.3f}"


def _missing(dossier: Dossier) -> list[Finding]:
    undecided = [row for row in dossier.rows if row.passed is None]
    results = []
    if undecided:
        kinds = sorted({row.status for row in undecided})
        parts = [f"{sum(row.status == k for row in undecided)} {k}" for k in kinds]
        text = (
            f"{len(undecided)} of {counted(len(dossier.rows), 'case')} "
            f"{agree(len(undecided), 'has', 'have')} no verdict "
            f"({', '.join(parts)}); none of them counts as passed."
        )
        results.append(Finding("missing", text, cases=_ids(undecided)))
    decided = [row for row in dossier.rows if row.passed is not None]
    blind = [row for row in decided if row.scalar("dtc_min_m") is None]
    # Where nothing stands in the lane no case has a distance, and none is missing.
    free = len(blind) == len(decided) and dossier.imported is None
    if blind and not free and dossier.scenario.stops_for_target:
        text = (
            f"Of {counted(len(blind), 'case', 'cases')} with a verdict the smallest distance is "
            "missing; the figures below leave them out."
        )
        results.append(Finding("missing", text, cases=_ids(blind)))
    return results


def _passed(dossier: Dossier) -> list[Finding]:
    results = []
    names = system_names(dossier)
    for model in names:
        rows = [row for row in dossier.rows if row.case.variation.model == model]
        passed = sum(row.passed is True for row in rows)
        low, high = wilson(passed, len(rows))
        text = (
            f"{names[model]} passed {passed} of {counted(len(rows), 'case', 'cases')} "
            f"({percent(passed / len(rows))}, 95 % interval {percent(low)} to {percent(high)})."
        )
        results.append(Finding("passed", text, cases=_ids(r for r in rows if r.passed is not True)))
    return results


def _systems(dossier: Dossier) -> list[Finding]:
    """Systems under test beside each other, in cases that differ in nothing else."""
    names = system_names(dossier)
    models = list(names)
    if not 2 <= len(models) <= SYSTEMS_MAX:
        return []
    axes = [axis for axis in varied_axes(dossier) if axis != "model"]
    decided: dict[str, dict[tuple[Any, ...], CaseRow]] = {model: {} for model in models}
    for row in dossier.rows:
        if row.passed is not None:
            point = tuple(axis_value(row.case, axis) for axis in axes)
            decided[row.case.variation.model][point] = row
    tests = []
    for one, two in itertools.combinations(models, 2):
        pairs = [(row, decided[two][at]) for at, row in decided[one].items() if at in decided[two]]
        if pairs:
            tests.append((one, two, pairs))
    corrected = holm([mcnemar(*_only(pairs)) for _, _, pairs in tests])
    results = [
        _pair(names[one], names[two], pairs, p_value)
        for (one, two, pairs), p_value in zip(tests, corrected, strict=True)
        if p_value < ALPHA
    ]
    if tests and not results:
        text = (
            f"No difference between the {len(models)} systems under test was found: McNemar's "
            f"test on paired cases, least corrected {p_text(min(corrected))}."
        )
        results.append(Finding("systems", text, min(corrected)))
    return results


def _only(pairs: Sequence[tuple[CaseRow, CaseRow]]) -> tuple[int, int]:
    first = sum(a.passed is True and b.passed is not True for a, b in pairs)
    second = sum(b.passed is True and a.passed is not True for a, b in pairs)
    return first, second


def _pair(one: str, two: str, pairs: list[tuple[CaseRow, CaseRow]], p_value: float) -> Finding:
    first, second = _only(pairs)
    if second > first:
        one, two, first, second = two, one, second, first
        pairs = [(b, a) for a, b in pairs]
    both = sum(a.passed is True and b.passed is True for a, b in pairs)
    gap = newcombe_paired(both, first, second, len(pairs) - both - first - second)
    text = (
        f"{one} passed {counted(first, 'case', 'cases')} that {two} lost under the same "
        f"conditions, the other way round {second} (of {len(pairs)} pairs; {one} ahead by "
        f"{points(gap.estimate)} points, 95 % interval {points(gap.low)} to {points(gap.high)}; "
        f"McNemar's exact test, corrected {p_text(p_value)})."
    )
    differing = [row for pair in pairs if pair[0].passed is not pair[1].passed for row in pair]
    return Finding("systems", text, p_value, _ids(differing))


def _axes(dossier: Dossier) -> list[Finding]:
    """The effect of every axis on every system under test that passes some cases and loses some."""
    tests: list[tuple[str, str, dict[Any, list[CaseRow]], Homogeneity]] = []
    axes = [axis for axis in varied_axes(dossier) if axis != "model"]
    values = {axis: axis_values(dossier, axis) for axis in axes}
    names = system_names(dossier)
    for model in names:
        rows = [r for r in dossier.rows if r.case.variation.model == model and r.passed is not None]
        if len({row.passed for row in rows}) < 2:
            continue
        for axis in axes:
            if len(values[axis]) > AXIS_VALUES_MAX:
                continue
            groups: dict[Any, list[CaseRow]] = {value: [] for value in values[axis]}
            for row in rows:
                groups[axis_value(row.case, axis)].append(row)
            groups = {value: group for value, group in groups.items() if group}
            if len(groups) > 1:
                counts = [(sum(r.passed is True for r in g), len(g)) for g in groups.values()]
                tests.append((names[model], axis, groups, homogeneity(counts)))
    corrected = holm([test.p_value for *_, test in tests])
    return [_axis(*test, p) for test, p in zip(tests, corrected, strict=True)]


def _axis(
    model: str, axis: str, groups: dict[Any, list[CaseRow]], test: Homogeneity, p_value: float
) -> Finding:
    name = axis_label(axis).partition(" [")[0].lower()
    how = f"{'exact' if test.exact else 'chi-square'} test, corrected {p_text(p_value)}"
    if p_value >= ALPHA:
        return Finding("axis", f"{model}: no effect of {name} was found ({how}).", p_value)

    def share(value: Any) -> float:
        return sum(row.passed is True for row in groups[value]) / len(groups[value])

    def passed_at(value: Any) -> str:
        passed = sum(row.passed is True for row in groups[value])
        return f"{passed} of {len(groups[value])} at {str(value).replace('_', ' ')}"

    order = sorted(groups, key=share)
    worst = [value for value in order if share(value) == share(order[0])]
    shown = ", ".join(passed_at(value) for value in worst[:3])
    more = f" and {len(worst) - 3} more" if len(worst) > 3 else ""
    text = (
        f"{model}: passing depends on {name} ({how}): fewest passed {shown}{more}; "
        f"most {passed_at(order[-1])}."
    )
    lost = [row for value in worst for row in groups[value] if row.passed is not True]
    return Finding("axis", text, p_value, _ids(lost))


def _hidden(dossier: Dossier) -> list[Finding]:
    """What the paper's rule, no collision, does not tell: cases without one that did not pass, by
    verdict; and passes that braked far away and then drove on."""
    unhurt = [row for row in dossier.rows if row.no_collision is True]
    if not unhurt:
        return []
    short = [row for row in unhurt if row.passed is not True]
    text = (
        f"Of {counted(len(unhurt), 'case', 'cases')} without a collision, {len(short)} did not pass"
    )
    parts = []
    for verdict in dict.fromkeys(row.status for row in short):
        rows = [row for row in short if row.status == verdict]
        parts.append(f"{len(rows)} {verdict.replace('_', ' ')}{_by_model(dossier, rows)}")
    results = [
        Finding("hidden", f"{text}{': ' if parts else ''}{', '.join(parts)}.", cases=_ids(short))
    ]
    return results + (_braked_early(dossier) if dossier.scenario.stops_for_target else [])


def _braked_early(dossier: Dossier) -> list[Finding]:
    """Passes that first braked so far from the obstacle that something else was the reason."""
    limit_m = EARLY * dossier.campaign.scenario.false_braking_m
    passed = [row for row in dossier.rows if row.passed is True]
    early = [row for row in passed if _beyond(row, "aeb_dtc_m", limit_m)]
    if not early:
        return []
    unknown = sum(not row.aeb_logged for row in passed)
    last = f" In {unknown} of the passes AEB was not logged." if unknown else ""
    text = (
        f"Of {counted(len(passed), 'pass', 'passes')}, {len(early)} first triggered AEB further "
        f"than {limit_m:g} m from the obstacle, {EARLY:g} times the limit of false braking, and "
        f"drove on{_by_model(dossier, early)}.{last}"
    )
    return [Finding("early", text, cases=_ids(early))]


def _by_model(dossier: Dossier, rows: list[CaseRow]) -> str:
    names = system_names(dossier)
    counts = [
        (name, sum(row.case.variation.model == m for row in rows)) for m, name in names.items()
    ]
    parts = [f"{name} {count}" for name, count in counts if count]
    return f" ({', '.join(parts)})" if parts and len(counts) > 1 else ""


def _beyond(row: CaseRow, scalar: str, limit_m: float) -> bool:
    value = row.scalar(scalar)
    return value is not None and math.isfinite(value) and value > limit_m


def _collisions(rows: list[CaseRow]) -> list[Finding]:
    hit = [row for row in rows if row.status == "collision"]
    if not hit:
        return []
    logged = [row for row in hit if row.aeb_logged]
    blind = [row for row in logged if row.scalar("aeb_time_s") is None]
    unknown = len(hit) - len(logged)
    last = f"; in {unknown} AEB was not logged" if unknown else ""
    text = (
        f"Of {counted(len(hit), 'collision', 'collisions')}, {len(blind)} came without any AEB "
        f"trigger and {len(logged) - len(blind)} in spite of one{last}."
    )
    return [Finding("collision", text, cases=_ids(hit))]


def _ids(rows: Iterable[CaseRow]) -> tuple[str, ...]:
    return tuple(row.case.id for row in rows)
