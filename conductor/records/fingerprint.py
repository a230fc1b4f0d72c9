"""The fingerprint of a campaign: equal if and only if every KPI value is equal to the last bit."""

from __future__ import annotations

import hashlib
import struct
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from conductor.records.attempts import attempt_file
from conductor.records.outcomes import CaseOutcome, Outcomes, read_outcomes
from schemas.words import unended
from twin.base.errors import InfrastructureError, UnfinishedError
from twin.base.progress import steps

if TYPE_CHECKING:
    import pyarrow as pa

KPI_FILE = "kpi.parquet"

REALTIME = "realtime: of this run alone, it repeats on no other"
"""What stands behind the fingerprint of a campaign that went by the wall clock."""


class Fingerprint(msgspec.Struct, frozen=True):
    """What ``conductor fingerprint`` prints."""

    sha256: str
    cases: int
    mixed: bool
    """Cases ran on more than one device class; such fingerprints need not be equal."""
    outcomes: dict[str, int]
    """``verdict/pass`` and so on -> cases."""
    realtime: bool = False
    """The cases went by the wall clock: no other run has this fingerprint."""

    @property
    def caveat(self) -> str:
        """What it is worth less than others, in words; empty: nothing."""
        if self.realtime:
            return REALTIME
        return "mixed" if self.mixed else ""


class Fingerprinter:
    """Takes the cases of a campaign one by one, in id order."""

    def __init__(self) -> None:
        self._sha = hashlib.sha256()
        self._counts: Counter[str] = Counter()

    def add(self, name: str, case: CaseOutcome, rows: bytes) -> None:
        """A case that has ended; ``rows`` is the canonical byte stream of its KPI columns, empty
        where it has no result."""
        label = label_of(case)
        self._counts[label] += 1
        for part in (name, label):
            data = part.encode()
            self._sha.update(struct.pack("<Q", len(data)) + data)
        self._sha.update(rows)

    def result(self, outcomes: Outcomes) -> Fingerprint:
        """The fingerprint of all cases that were added."""
        return Fingerprint(
            sha256=self._sha.hexdigest(),
            cases=len(outcomes.cases),
            mixed=len(outcomes.device_classes) > 1,
            realtime=outcomes.clock == "realtime",
            outcomes=dict(sorted(self._counts.items())),
        )


def fingerprint(folder: Path) -> Fingerprint:
    """Fingerprint of the campaign ``folder``.

    SHA-256 over all cases in id order: id, outcome with verdict, then the canonical byte stream of
    the KPI columns where the case has a result. Parts are length-prefixed.

    Raises:
        UsageError: the folder holds no outcomes (yet).
        UnfinishedError: cases are left.
        InfrastructureError: a KPI file is missing, damaged, or not the one that was committed.
    """
    outcomes = read_outcomes(folder)
    if not outcomes.complete:
        left = sum(not case.outcome for case in outcomes.cases.values())
        raise UnfinishedError(
            f"{folder}: {unended(left, len(outcomes.cases))}; run the campaign again to finish it"
        )
    fingerprinter = Fingerprinter()
    for name, case in steps("KPI files", sorted(outcomes.cases.items())):
        fingerprinter.add(
            name, case, committed_rows(folder, name, case)[1] if case.kpi_sha256 else b""
        )
    return fingerprinter.result(outcomes)


def label_of(case: CaseOutcome) -> str:
    """Outcome with verdict, e.g. ``verdict/pass``."""
    return f"{case.outcome}/{case.verdict}" if case.verdict else case.outcome


def kpi_path(folder: Path, name: str, case: CaseOutcome) -> Path:
    """The KPI file of the committed attempt.

    Raises:
        InfrastructureError: the outcomes name a folder outside the campaign's, or it is a link.
    """
    try:
        return attempt_file(folder, case.attempt_dir, KPI_FILE)
    except InfrastructureError as error:
        raise InfrastructureError(f"case {name}: {error}") from None


def committed_rows(folder: Path, name: str, case: CaseOutcome) -> tuple[pa.Table, bytes]:
    """KPI rows of a committed attempt, as a table and as their canonical byte stream.

    Raises:
        InfrastructureError: the file is missing, damaged, or not the one that was committed.
    """
    # Late: a run begins without Parquet, whose import takes a fifth of its command's start.
    from twin.records.kpi_file import canonical, read_kpi

    path = kpi_path(folder, name, case)
    try:
        table = read_kpi(path)
    except InfrastructureError as error:
        raise InfrastructureError(f"case {name}: {error}") from None
    rows = b"".join(canonical(table))
    digest = hashlib.sha256(rows).hexdigest()
    if digest != case.kpi_sha256:
        raise InfrastructureError(
            f"case {name}: {path} is not the file that was committed (its values give "
            f"{digest[:12]}, committed {case.kpi_sha256[:12]}); restore it or run again"
        )
    return table, rows
