"""Rows of a certificate beside what the same cases came to here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

from msgspec import Struct

from conductor.certify.draw import bound
from conductor.certify.form import Certificate
from conductor.certify.rows import Row
from conductor.records.fingerprint import label_of
from conductor.records.outcomes import CaseOutcome, Outcomes
from schemas.words import counted
from twin.base.errors import EXIT_FAILED, EXIT_INFRASTRUCTURE, EXIT_PASS

Kind = Literal["same", "false", "undecided", "not run"]
"""``false``: another result on the same device class. ``undecided``: another result on another
device class, whose bytes may differ. ``not run``: it came to no result here."""


class DrawnCase(Struct, frozen=True):
    """One drawn case."""

    case: str
    kind: Kind
    certified: str
    """Outcome in the certificate."""
    here: str
    """Outcome here."""
    words: str = ""
    """What differs, the certificate's value first; empty: nothing."""


class Audited(Struct, frozen=True, kw_only=True):
    """What an audit has found."""

    name: str
    root: str
    seed: str
    rows: int
    """Rows that have a result, from which cases were drawn."""
    without_result: int
    """Rows that say that their case came to none; nothing is claimed of these."""
    findings: list[DrawnCase]

    def count(self, kind: Kind) -> int:
        """Number of drawn cases of a kind."""
        return sum(finding.kind == kind for finding in self.findings)

    @property
    def exit_code(self) -> int:
        """1 if a row is false; 3 if one could not be decided here; else 0."""
        if self.count("false"):
            return EXIT_FAILED
        return EXIT_PASS if self.count("same") == len(self.findings) else EXIT_INFRASTRUCTURE

    @property
    def bound(self) -> str:
        """What follows for the whole table; empty: a drawn case was not the same."""
        drawn = len(self.findings)
        return bound(self.rows, drawn) if self.count("same") == drawn else ""

    @property
    def words(self) -> str:
        """The conclusion, a line."""
        drawn = counted(len(self.findings), "case")
        if false := self.count("false"):
            return f"false: {false} of {drawn} drawn came to something else here"
        if not self.bound:
            left = len(self.findings) - self.count("same")
            return f"undecided: {left} of {drawn} drawn cannot be decided on this machine"
        return f"holds: {drawn} drawn of {self.rows}, all the same; {self.bound}"


def compared(
    certificate: Certificate,
    drawn: Sequence[str],
    seed: str,
    here: Outcomes,
    values: Callable[[str], str] = lambda _case: "",
) -> Audited:
    """Hold the drawn rows against what their cases came to here.

    Args:
        certificate: the certificate.
        drawn: names of cases.
        seed: by which they were drawn.
        here: outcomes of these cases, run again.
        values: which KPI values of a case differ, where the run's folder is at hand.
    """
    rows = {row.case: row for row in certificate.rows}
    findings = [
        _finding(rows[name], certificate.device_class(rows[name]), here.cases[name], values)
        for name in drawn
    ]
    claimed = sum(row.has_result for row in certificate.rows)
    return Audited(
        name=certificate.head.name,
        root=certificate.head.root,
        seed=seed,
        rows=claimed,
        without_result=len(certificate.rows) - claimed,
        findings=findings,
    )


def _finding(
    row: Row, device_class: str, here: CaseOutcome, values: Callable[[str], str]
) -> DrawnCase:
    label = label_of(here)
    if (label, here.kpi_sha256) == (row.outcome, row.kpi):
        return DrawnCase(row.case, "same", row.outcome, label)
    if here.outcome not in ("verdict", "failed"):
        return DrawnCase(row.case, "not run", row.outcome, label, "; ".join(here.charges[:1]))
    words = _difference(row, label, here)
    if more := values(row.case):
        words += f"; {more}"
    if device_class == here.device_class:
        return DrawnCase(row.case, "false", row.outcome, label, words)
    words += f" (certified on {device_class or 'no device'}, here {here.device_class or 'none'})"
    return DrawnCase(row.case, "undecided", row.outcome, label, words)


def _difference(row: Row, label: str, here: CaseOutcome) -> str:
    parts = [f"{row.outcome} against {label}"] if row.outcome != label else []
    if row.kpi != here.kpi_sha256:
        parts.append(f"KPIs {row.kpi[:12] or 'none'} against {here.kpi_sha256[:12] or 'none'}")
    return ", ".join(parts)


def lines(audited: Audited, shown_max: int) -> list[str]:
    """An audit for people: the conclusion, then at most ``shown_max`` cases that differ."""
    said = [audited.words]
    differ = [finding for finding in audited.findings if finding.kind != "same"]
    said += [f"  {each.case}: {each.kind}: {each.words}" for each in differ[:shown_max]]
    if len(differ) > shown_max:
        said.append(f"  and {len(differ) - shown_max} more; --output json lists all")
    if undecided := [each for each in differ if each.kind == "undecided"]:
        equal = sum(each.certified == each.here for each in undecided)
        said.append(
            f"{len(undecided)} undecided: bytes need not be equal between these device classes; "
            f"{equal} of them have the same verdict"
        )
    if audited.without_result:
        said.append(
            f"{counted(audited.without_result, 'row')} without a result: nothing is claimed of "
            "them, and none was drawn"
        )
    return said
