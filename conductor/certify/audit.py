"""An audit: cases of a certificate, drawn by a seed, run again here and compared byte by byte."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
from msgspec import Struct

from conductor.certify.comparing import Audited, compared
from conductor.certify.consent import Consent
from conductor.certify.draw import checked_seed, draw
from conductor.certify.form import Certificate
from conductor.certify.making import row_of
from conductor.certify.rows import Sha
from conductor.certify.software import require_files, require_libraries, same_files
from conductor.certify.subject import plan_in, prepared
from conductor.records.outcomes import Outcomes, read_outcomes
from conductor.records.sameness import difference
from conductor.trust.sign_run import require_agreement, require_fit
from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import read_regular
from schemas.plan import Plan
from schemas.words import counted
from twin.base.errors import (
    EXIT_INTERRUPTED,
    EXIT_UNFINISHED,
    InfrastructureError,
    UsageError,
    storage_error,
)
from twin.base.files import write_atomic

FILE_NAME = "audit.json"
FILE_BYTES_MAX = 1 << 16
"""Largest note of an audit in its folder [bytes]."""

RunCases = Callable[[Plan, Path], int]
"""Runs a plan into a folder, or goes on there; the exit code."""


class AuditNote(Struct, frozen=True, forbid_unknown_fields=True):
    """What an audit's folder is for, so that the same command goes on."""

    certificate: Sha
    """Root of its rows."""
    seed: str
    cases: int


@dataclass(frozen=True, slots=True)
class AuditOptions:
    """Options of the command line."""

    cases: int
    seed: str = ""
    """Empty: that of the folder, or a new one."""
    out: Path | None = None
    run: Path | None = None
    """Folder of the run that was certified, if it is at hand."""
    consent: Consent = field(default_factory=Consent)


def audit(
    certificate: Certificate, shown: str, options: AuditOptions, run_cases: RunCases
) -> Audited | int:
    """Draw cases, run them again and compare.

    Args:
        certificate: the certificate, whose signature fits.
        shown: its name for messages.
        options: of the command line.
        run_cases: runs cases on this machine.

    Returns:
        What was found; or the exit code of a run that was stopped.

    Raises:
        UsageError: the auditor's word or a file is missing.
        InfrastructureError: it is about another campaign, software, stack or run.
    """
    require_files(certificate, shown)
    plan = plan_in(certificate, shown)
    require_libraries(certificate, plan.campaign, shown)
    claimed = [row.case for row in certificate.rows if row.has_result]
    if not claimed:
        raise UsageError(f"{shown}: no row of it has a result; there is nothing to run again")
    if options.run is not None:
        _require_run(certificate, options.run, shown)
    ready = prepared(certificate, plan, options.consent, shown)
    folder = options.out or Path("runs") / f"audit-{ready.campaign.campaign}-{_short(certificate)}"
    note = _noted(folder, certificate, options)
    drawn = draw(certificate.head.root, note.seed, claimed, note.cases)
    code = run_cases(ready.among(drawn), folder)
    if code in (EXIT_INTERRUPTED, EXIT_UNFINISHED):
        return code
    require_agreement(folder)
    here = read_outcomes(folder)
    return compared(certificate, drawn, note.seed, here, _values(options.run, folder, here))


def inspect(certificate: Certificate, shown: str) -> str:
    """Look at a certificate and run nothing; what was found, a line.

    Raises:
        InfrastructureError: its campaign is not that of its rows.
    """
    if not same_files(certificate):
        return "as it was signed; other software made it, so its campaign was not looked at"
    plan_in(certificate, shown)
    return "as it was signed, and its rows are those of its campaign; nothing was run again"


def _short(certificate: Certificate) -> str:
    return certificate.head.root[:8]


def _noted(folder: Path, certificate: Certificate, options: AuditOptions) -> AuditNote:
    """What the audit in ``folder`` is; written down if it begins."""
    root = certificate.head.root
    before = _read_note(folder)
    if before is None:
        seed = checked_seed(options.seed or secrets.token_hex(16))
        note = AuditNote(certificate=root, seed=seed, cases=options.cases)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if any(folder.iterdir()):
                raise UsageError(f"{folder}: holds something, and no audit; give another --out")
            write_atomic(folder / FILE_NAME, msgspec.json.encode(note) + b"\n")
        except OSError as error:
            raise storage_error(error, str(folder)) from None
        return note
    asked = AuditNote(certificate=root, seed=options.seed or before.seed, cases=options.cases)
    if asked != before:
        raise UsageError(
            f"{folder}: holds an audit of {counted(before.cases, 'case')} by seed "
            f"'{before.seed}' of the table {before.certificate[:8]}; give another --out"
        )
    return before


def _read_note(folder: Path) -> AuditNote | None:
    path = folder / FILE_NAME
    try:
        note: AuditNote = decode_json(read_regular(path, FILE_BYTES_MAX), AuditNote)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise storage_error(error, str(path)) from None
    except JsonError as error:
        raise InfrastructureError(f"{path}: damaged: {error}; give another --out") from None
    return note


def _require_run(certificate: Certificate, run: Path, shown: str) -> None:
    """The folder of the run has the table that was certified."""
    require_fit(run)
    outcomes = read_outcomes(run)
    classes = certificate.head.made_in.device_classes
    if outcomes.device_classes != classes:
        raise InfrastructureError(f"{run}: is not the run of {shown}: other device classes")
    rows = [row_of(name, case, classes) for name, case in outcomes.cases.items()]
    odd = [new.case for new, row in zip(rows, certificate.rows, strict=False) if new != row]
    if len(rows) != len(certificate.rows) or odd:
        what = f"case {odd[0]} is another" if odd else f"has {counted(len(rows), 'case')}"
        raise InfrastructureError(f"{run}: is not the run of {shown}: {what}")


def _values(run: Path | None, folder: Path, here: Outcomes) -> Callable[[str], str]:
    """Which KPI values of a case differ between the certified run and the audit."""
    if run is None:
        return lambda _case: ""
    there = read_outcomes(run)
    return lambda case: difference((run, there), (folder, here), case)
