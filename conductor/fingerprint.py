"""The fingerprint of a campaign: equal if and only if every KPI value is equal to the last bit."""

from __future__ import annotations

import hashlib
import struct
from collections import Counter
from pathlib import Path, PurePosixPath

import msgspec

from conductor.outcomes import CaseOutcome, read_outcomes
from twin.fabric.errors import InfrastructureError, UnfinishedError
from twin.fabric.kpi_file import canonical, read_kpi

KPI_FILE = "kpi.parquet"


class Fingerprint(msgspec.Struct, frozen=True):
    """What ``conductor fingerprint`` prints."""

    sha256: str
    cases: int
    mixed: bool
    """Cases ran on more than one device class; such fingerprints need not be equal."""
    outcomes: dict[str, int]
    """``verdict/pass`` and so on -> cases."""


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
            f"{folder}: {left} of {len(outcomes.cases)} cases have not ended; "
            "run the campaign again to finish it"
        )
    sha = hashlib.sha256()
    counts: Counter[str] = Counter()
    for name, case in sorted(outcomes.cases.items()):
        label = f"{case.outcome}/{case.verdict}" if case.verdict else case.outcome
        counts[label] += 1
        for part in (name, label):
            data = part.encode()
            sha.update(struct.pack("<Q", len(data)) + data)
        if case.kpi_sha256:
            _add_kpi(sha, folder, name, case)
    return Fingerprint(
        sha256=sha.hexdigest(),
        cases=len(outcomes.cases),
        mixed=len(outcomes.device_classes) > 1,
        outcomes=dict(sorted(counts.items())),
    )


def _add_kpi(sha: hashlib._Hash, folder: Path, name: str, case: CaseOutcome) -> None:
    attempt = PurePosixPath(case.attempt_dir)
    if attempt.is_absolute() or ".." in attempt.parts:
        raise InfrastructureError(f"case {name}: attempt folder '{attempt}' is outside {folder}")
    path = folder / attempt / KPI_FILE
    own = hashlib.sha256()
    for part in canonical(read_kpi(path)):
        own.update(part)
        sha.update(part)
    if own.hexdigest() != case.kpi_sha256:
        raise InfrastructureError(
            f"case {name}: {path} is not the file that was committed (its values give "
            f"{own.hexdigest()[:12]}, committed {case.kpi_sha256[:12]}); restore it or run again"
        )
