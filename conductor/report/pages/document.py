"""``report.html`` in the campaign folder; and the same report as plain data."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from conductor.report.analysis.highlights import judged_rest_m
from conductor.report.analysis.perception_cost import perception_costs
from conductor.report.pages.content import Content, Shown, first_screen, read_content
from conductor.report.pages.page import render
from conductor.report.pages.summary import write_summary_of
from conductor.report.pages.tables import case_record, verdict_table
from conductor.report.plots.files import write_plots
from conductor.report.reading.dossier import open_dossier
from conductor.report.reading.films import make_films
from conductor.report.reading.recorded import Failure, failures
from conductor.report.reading.resources import gather_resources
from conductor.report.reading.resources_use import Resources, Use
from conductor.report.reading.speedup import SpeedUp
from conductor.report.rulebook.shown import rulebook_shown
from conductor.report.searching.section import mildest
from schemas.files.rulebook_result import FILE_NAME as RULEBOOK_FILE
from twin.base.errors import storage_error
from twin.base.files import write_atomic

PAGE_FILE = "report.html"


@dataclass(frozen=True, slots=True)
class WrittenReport:
    """Report that :func:`make_report` has made."""

    page: Path
    plots: list[Path]
    plots_missing: str
    """Which plots are left out, and why; empty: none."""
    content: Content
    films: list[Path] = field(default_factory=list)
    """Films of cases that did not pass."""
    films_missing: list[str] = field(default_factory=list)
    """Lines about films that are left out."""


def make_report(
    folder: Path,
    *,
    anew: bool = False,
    serial: Path | None = None,
    plots: bool = True,
    films: bool = False,
    read: Shown | None = None,
) -> WrittenReport:
    """Write ``summary.parquet``, ``summary.csv``, ``resources.parquet``, ``report.html``, of a
    rulebook ``rulebook.json``, and the plots, into the campaign ``folder``.

    Damaged KPI files and disagreeing attempts do not stop the report: it says so in an alarm box.
    A campaign that still runs is reported as it stands.

    Args:
        folder: of the campaign.
        anew: read every KPI file, also those that an earlier report has read.
        serial: folder in which the same campaign was run one case at a time, for the speed-up.
        plots: draw the plots as well, which for 256 cases takes as long as all the rest.
        films: make films of the cases that did not pass and that the page shows: of a rulebook's
            tables the worst run of each cell.
        read: KPI files that this process has just read (:func:`read_shown`).

    Raises:
        UsageError: no campaign was run here, or nothing was simulated in it.
        InfrastructureError: campaign or outcomes are damaged, or the disk lets us down.
    """
    dossier = open_dossier(folder)
    content = read_content(dossier, anew=anew, serial=serial, read=read)
    write_summary_of(dossier)
    gather_resources(dossier.folder, complete=dossier.outcomes.complete)
    path = folder / PAGE_FILE
    try:
        lost = failures(dossier, mildest(content.search))
        made, unmade = _films(content, lost) if films else ([], [])
        write_atomic(path, render(content, lost).encode())
        if content.rulebook is not None:
            data = msgspec.json.format(msgspec.json.encode(content.rulebook), indent=1)
            write_atomic(folder / RULEBOOK_FILE, data + b"\n")
        drawn, missing = write_plots(content) if plots else ([], "")
    except OSError as error:
        raise storage_error(error, str(error.filename or path)) from None
    return WrittenReport(path, drawn, missing, content, made, unmade)


def _films(content: Content, lost: list[Failure]) -> tuple[list[Path], list[str]]:
    """Films of the examples of lost cases and of a rulebook's worst runs, as
    :func:`conductor.report.reading.films.make_films` gives them."""
    book = rulebook_shown(content.dossier, content.rulebook)
    wanted = {failure.row.case.id for failure in lost} | set(book.worst_lost if book else ())
    return make_films(content.dossier, [r for r in content.dossier.rows if r.case.id in wanted])


def report_json(folder: Path) -> dict[str, Any]:
    """The report's tables as plain data, for programs.

    Raises:
        UsageError: no campaign was run here, or nothing was simulated in it.
        InfrastructureError: campaign or outcomes are damaged.
    """
    return tables_of(read_content(open_dossier(folder)))


def tables_of(content: Content) -> dict[str, Any]:
    """The tables of a report that has been read already."""
    dossier, evidence = content.dossier, content.evidence
    outcomes, ran = dossier.outcomes, dossier.imported is None
    return {
        "campaign": outcomes.campaign,
        "description": dossier.campaign.description,
        "complete": outcomes.complete,
        "running": dossier.running,
        "cases_total": len(dossier.rows),
        "passed": dossier.passed,
        "no_collision": dossier.no_collision,
        "not_ended": dossier.left,
        "digest": outcomes.digest,
        "seed": outcomes.seed if ran else None,
        "software": outcomes.software or None,
        "stack": dossier.campaign.stack_identity.digest or None,
        "protection": outcomes.protection if ran else None,
        "device_classes": outcomes.device_classes if ran else None,
        "signature": content.signature,
        "fingerprint": evidence.fingerprint.sha256 if evidence.fingerprint else None,
        "fingerprint_missing": evidence.fingerprint_missing or None,
        "alarms": evidence.alarms,
        "audits": evidence.audits,
        "disagreements": evidence.disagreements,
        "imported": msgspec.to_builtins(dossier.imported),
        "notices": first_screen(dossier),
        "systems": [
            {**asdict(line), "rate": line.rate, "interval": line.interval}
            for line in verdict_table(dossier)
        ],
        "findings": [asdict(finding) for finding in content.findings],
        "effects": [asdict(effect) for effect in content.effects],
        "cases": [
            {
                **case_record(dossier, row),
                "false_braking_dtc_m": judged_rest_m(row, content.rests_m.get(row.case.id, [])),
            }
            for row in dossier.rows
        ],
        "rulebook": msgspec.to_builtins(content.rulebook),
        "search": msgspec.to_builtins(content.search),
        "coverage": msgspec.to_builtins(content.coverage),
        "perception": [asdict(line) for line in perception_costs(dossier)],
        "resources": _resources(content.resources) if ran else None,
        "speed": _speed(content.speed_up) if ran else None,
        "sites": [asdict(line) for line in content.sites],
    }


def _speed(speed_up: SpeedUp) -> dict[str, Any]:
    return {
        "run": asdict(speed_up.run),
        "serial": asdict(speed_up.serial) if speed_up.serial else None,
        "speed_up": speed_up.factor,
        "efficiency": speed_up.efficiency,
        "missing": speed_up.missing or None,
    }


def _resources(resources: Resources) -> dict[str, Any]:
    def line(use: Use) -> dict[str, Any]:
        spans = {name: span and asdict(span) for name, span in use.spans.items()}
        return {**{k: v for k, v in asdict(use).items() if k != "spans"}, **spans}

    return {
        "samples": resources.samples,
        "missing": resources.missing or None,
        "batches": [line(use) for use in resources.batches],
        "workers": [line(use) for use in resources.workers],
        "nodes": [line(use) for use in resources.nodes],
        "total": line(resources.total) if resources.total else None,
    }
