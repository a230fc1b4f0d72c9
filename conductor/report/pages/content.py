"""What the page and the data are made of: the dossier, with its files read and checked."""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from pathlib import Path

from conductor.report.analysis.effects import Effect, main_effects
from conductor.report.analysis.findings import Finding, findings
from conductor.report.pages.tables import statuses
from conductor.report.reading.curves import KpiCurve, points_for
from conductor.report.reading.dossier import CaseRow, Dossier
from conductor.report.reading.evidence import Evidence, gather
from conductor.report.reading.kpi_files import NOTHING_KNOWN, Known, KpiReading, read_cases
from conductor.report.reading.leases import Leases, read_leases
from conductor.report.reading.resources import read_resources
from conductor.report.reading.resources_use import Resources, no_resources, resources_of
from conductor.report.reading.site_shares import SiteShare, prices_of, site_shares
from conductor.report.reading.speedup import SpeedUp, speed_up
from conductor.report.rulebook.results import rulebook_result
from conductor.report.searching.grid_coverage import grid_coverage
from conductor.report.searching.section import read_shown_search
from conductor.trust.sign_run import require_fit
from schemas.files.rulebook_result import RulebookResult
from schemas.files.search_result import SearchCoverage, SearchFile
from schemas.words import counted
from twin.base.errors import InfrastructureError

CASES_MAX = 2000
"""Most cases with a table row and curves; a larger campaign shows its worst first."""


@dataclass(frozen=True, slots=True)
class Content:
    """A dossier with everything that was read and checked for it."""

    dossier: Dossier
    shown: list[CaseRow]
    """Cases with a table row and curves, in campaign order."""
    curves: dict[str, KpiCurve]
    rests_m: dict[str, list[float]]
    """Distances to the obstacle where the ego came to rest, in order, by case [m]."""
    damaged: int
    """KPI files that could not be read."""
    read: int
    """KPI files that were read; the others are as an earlier report found them."""
    evidence: Evidence
    resources: Resources
    leases: Leases
    sites: list[SiteShare]
    """What each site has done; none: its workers are of no site."""
    speed_up: SpeedUp
    effects: list[Effect]
    findings: list[Finding]
    as_of: str
    """When the outcomes were written, for people."""
    signature: str
    """Words about who has signed the run, or that nobody has."""
    rulebook: RulebookResult | None
    """Result of its rulebook; None: it has none."""
    search: SearchFile | None
    """Its search; None: it is none."""
    coverage: SearchCoverage | None
    """What was tried of its domain, and what never; None: it is not known, or nothing is left."""

    @property
    def unchanged(self) -> int:
        """KPI files that an earlier report had read."""
        files = sum(bool(row.end.kpi_sha256) for row in self.dossier.rows)
        return files - self.read - self.damaged


Shown = tuple[set[str], KpiReading]
"""Cases with a table row and curves, and what the KPI files of all cases say."""


def read_content(
    dossier: Dossier,
    *,
    anew: bool = False,
    serial: Path | None = None,
    read: Shown | None = None,
) -> Content:
    """Read and check the KPI files; keep the curves of the cases that are shown.

    Args:
        dossier: the campaign.
        anew: read every file, also those that an earlier report has read and that are unchanged.
        serial: folder in which the same campaign was run one case at a time, for the speed-up.
        read: what this process has just read of :func:`read_shown`; nothing is read again.

    Raises:
        UsageError: ``serial`` is no such folder.
        InfrastructureError: the run is not as it was signed.
    """
    origin = require_fit(dossier.folder)
    anew = anew or not origin.cache_fits
    leases = read_leases(dossier.folder)
    pace = speed_up(dossier, leases, serial)  # before the long part: it may refuse
    shown, reading = read or read_shown(dossier, anew=anew)
    evidence = gather(dossier, reading.broken, reading.fingerprint)
    known = evidence.fingerprint
    search = read_shown_search(dossier.folder)
    return Content(
        dossier=dossier,
        shown=[row for row in dossier.rows if row.case.id in shown],
        curves=reading.curves,
        rests_m=reading.rests_m,
        damaged=reading.damaged,
        read=reading.read,
        evidence=evidence,
        resources=_resources(dossier),
        leases=leases,
        sites=site_shares(dossier.outcomes.cases, leases, prices_of(dossier.folder)),
        speed_up=pace,
        effects=main_effects(dossier),
        findings=findings(dossier),
        as_of=_as_of(dossier),
        signature=origin.words,
        rulebook=rulebook_result(dossier, known.sha256 if known else ""),
        search=search,
        coverage=search.coverage if search else grid_coverage(dossier),
    )


def first_screen(dossier: Dossier) -> list[str]:
    """Lines that are told before anything else. Of a campaign: what its stack knew beyond its
    needs. Of imported logs: why they are doubtful, how their cases ended, and how many pass by the
    study's rule alone."""
    imported, rows = dossier.imported, dossier.rows
    if imported is None:
        tell = ", ".join(dossier.outcomes.tell)
        return [f"The stack was told more than it needs: {tell} (autonomy.tell)."] if tell else []
    limit_m = dossier.campaign.scenario.false_braking_m
    remarks = {
        "false_braking": f" (stopped further than {limit_m:g} m from the obstacle)",
        "unresolved": " (the log does not decide the case)",
    }
    parts = [f"{dossier.passed} of {counted(len(rows), 'case', 'cases')} passed"]
    for status in statuses(dossier):
        number = sum(row.status == status for row in rows)
        if number and status != "pass":
            parts.append(f"{number} {status.replace('_', ' ')}{remarks.get(status, '')}")
    unknown = sum(row.no_collision is None for row in rows)
    more = f", not known of {unknown}" if unknown else ""
    return [
        *imported.warnings,
        f"{', '.join(parts)}. Without a collision, the rule of the AutoDRIVE study: "
        f"{dossier.no_collision} of {len(rows)}{more}.",
    ]


def read_shown(dossier: Dossier, *, anew: bool = False, known: Known = NOTHING_KNOWN) -> Shown:
    """Cases with a table row and curves, and what was read; those that did not pass come first."""
    order = sorted(range(len(dossier.rows)), key=lambda i: dossier.rows[i].passed is True)
    shown = {dossier.rows[i].case.id for i in order[:CASES_MAX]}
    return shown, read_cases(dossier, shown, points_of(len(order)), anew=anew, known=known)


def points_of(cases: int) -> int:
    """Points of a curve in the report of so many cases."""
    return points_for(min(cases, CASES_MAX))


def _as_of(dossier: Dossier) -> str:
    written = datetime.datetime.fromtimestamp(dossier.written_s, datetime.UTC)
    return written.strftime("%Y-%m-%d %H:%M:%S UTC")


def _resources(dossier: Dossier) -> Resources:
    """Results stand without them, so a damaged file is told in their section, not as an alarm."""
    try:
        return resources_of(dossier, read_resources(dossier.folder))
    except InfrastructureError as error:
        return no_resources(str(error))
