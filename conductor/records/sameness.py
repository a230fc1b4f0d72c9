"""Whether two runs are the same to the last bit, and where they differ first."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa

from conductor.records.fingerprint import Fingerprint, committed_rows, fingerprint, label_of
from conductor.records.outcomes import CaseOutcome, Outcomes, read_outcomes
from schemas.words import counted
from twin.records.kpi_file import canonical

COLUMNS_NAMED_MAX = 4
"""Most columns that a line names."""


class Difference(msgspec.Struct, frozen=True):
    """One case that is not the same in both runs."""

    case: str
    words: str
    """What differs, the first run's value first."""


class Sameness(msgspec.Struct, frozen=True):
    """Two runs side by side."""

    fingerprints: tuple[Fingerprint, Fingerprint]
    differences: list[Difference]
    """Differences in id order; empty: every case is the same."""
    notes: list[str]
    """What may be the reason."""

    @property
    def same(self) -> bool:
        """Outcome, verdict and every KPI value of every case are equal to the last bit."""
        first, second = self.fingerprints
        return first.sha256 == second.sha256


def sameness(first: Path, second: Path) -> Sameness:
    """Compare two campaign folders.

    Raises:
        UsageError: a folder holds no outcomes (yet).
        UnfinishedError: cases are left.
        InfrastructureError: a KPI file is missing, damaged, or not the one that was committed.
    """
    prints = fingerprint(first), fingerprint(second)
    if prints[0].sha256 == prints[1].sha256:
        return Sameness(prints, [], [])
    left, right = read_outcomes(first), read_outcomes(second)
    differences = []
    for name in sorted({*left.cases, *right.cases}):
        words = difference((first, left), (second, right), name)
        if words:
            differences.append(Difference(name, words))
    return Sameness(prints, differences, list(_reasons(left, right)))


def difference(first: tuple[Path, Outcomes], second: tuple[Path, Outcomes], name: str) -> str:
    """What of a case differs; empty: nothing."""
    for (_, there), (folder, elsewhere) in ((first, second), (second, first)):
        if name in elsewhere.cases and name not in there.cases:
            return f"only in {folder}"
    one, two = first[1].cases[name], second[1].cases[name]
    if label_of(one) != label_of(two):
        return f"{label_of(one)} against {label_of(two)}"
    if one.kpi_sha256 == two.kpi_sha256:
        return ""
    if not (one.kpi_sha256 and two.kpi_sha256):
        return f"no KPIs in {second[0] if one.kpi_sha256 else first[0]}"
    return _rows_differ(_rows(first[0], name, one), _rows(second[0], name, two))


def _rows(folder: Path, name: str, case: CaseOutcome) -> pa.Table:
    return committed_rows(folder, name, case)[0]


def _rows_differ(one: pa.Table, two: pa.Table) -> str:
    """Which columns differ, and the first value that does."""
    if one.num_rows != two.num_rows:
        return f"{counted(one.num_rows, 'tick')} against {two.num_rows}"
    if odd := sorted({*one.column_names} ^ {*two.column_names}):
        return f"KPI column {odd[0]} is in one of them only"
    names = [name for name in one.column_names if _bytes(one, name) != _bytes(two, name)]
    tick, name, values = min(
        (_first(one, two, name) for name in names), key=lambda difference: difference[0]
    )
    more = f" and {len(names) - COLUMNS_NAMED_MAX} more" if len(names) > COLUMNS_NAMED_MAX else ""
    shown = ", ".join(names[:COLUMNS_NAMED_MAX])
    return f"{shown}{more}; first {name} at tick {tick}: {values[0]} against {values[1]}"


def _bytes(table: pa.Table, name: str) -> bytes:
    """A column as the fingerprint sees it."""
    return b"".join(canonical(table, (name,)))


def _first(one: pa.Table, two: pa.Table, name: str) -> tuple[int, str, tuple[Any, Any]]:
    """The first tick whose value differs, the column, and both values."""
    pairs = zip(one[name].to_pylist(), two[name].to_pylist(), strict=True)
    for tick, (left, right) in enumerate(pairs):
        if repr(left) != repr(right):  # as text: NaN is equal to itself, and 0.0 not to -0.0
            return tick, name, (left, right)
    raise AssertionError(f"column {name}: bytes differ and no value does")


def _reasons(left: Outcomes, right: Outcomes) -> Iterator[str]:
    """What was not the same before anything was simulated."""
    for what, one, two in (
        ("seed", left.seed, right.seed),
        ("software", left.software[:12], right.software[:12]),
        ("device class", "+".join(left.device_classes), "+".join(right.device_classes)),
        ("clock", left.clock, right.clock),
    ):
        if one != two:
            yield f"{what}: {one} against {two}"
    if left.digest != right.digest and left.seed == right.seed:
        yield "the campaigns differ, see campaign.yaml of both"
