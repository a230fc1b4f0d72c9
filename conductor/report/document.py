"""``report.html`` in the campaign folder; and the same report as plain data."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec

from conductor.report.content import read_content
from conductor.report.dossier import open_dossier
from conductor.report.findings import findings
from conductor.report.page import render
from conductor.report.perception_cost import perception_costs
from conductor.report.resources import gather_resources
from conductor.report.resources_use import Resources, Use
from conductor.report.summary import write_summary_of
from conductor.report.tables import case_record, verdict_table
from twin.fabric.errors import storage_error
from twin.fabric.files import write_atomic

PAGE_FILE = "report.html"


def write_report(folder: Path) -> Path:
    """Write ``summary.parquet``, ``summary.csv``, ``resources.parquet`` and ``report.html``, into
    the campaign ``folder``.

    Damaged KPI files and disagreeing attempts do not stop the report: it says so in an alarm box.

    Returns:
        Path of the page.

    Raises:
        UsageError: no campaign was run here, or nothing was simulated in it.
        InfrastructureError: campaign or outcomes are damaged, or the disk lets us down.
    """
    dossier = open_dossier(folder)
    write_summary_of(dossier)
    gather_resources(dossier.folder, complete=dossier.outcomes.complete)
    page = render(read_content(dossier))
    path = folder / PAGE_FILE
    try:
        write_atomic(path, page.encode())
    except OSError as error:
        raise storage_error(error, str(path)) from None
    return path


def report_json(folder: Path) -> dict[str, Any]:
    """The report's tables as plain data, for programs.

    Raises:
        UsageError: no campaign was run here, or nothing was simulated in it.
        InfrastructureError: campaign or outcomes are damaged.
    """
    content = read_content(open_dossier(folder))
    dossier, evidence = content.dossier, content.evidence
    outcomes = dossier.outcomes
    return {
        "campaign": outcomes.campaign,
        "description": dossier.campaign.description,
        "complete": outcomes.complete,
        "running": dossier.running,
        "cases_total": len(dossier.rows),
        "passed": dossier.passed,
        "not_ended": dossier.left,
        "digest": outcomes.digest,
        "seed": outcomes.seed,
        "software": outcomes.software or None,
        "device_classes": outcomes.device_classes,
        "fingerprint": evidence.fingerprint.sha256 if evidence.fingerprint else None,
        "fingerprint_missing": evidence.fingerprint_missing or None,
        "alarms": evidence.alarms,
        "audits": evidence.audits,
        "disagreements": evidence.disagreements,
        "imported": msgspec.to_builtins(dossier.imported),
        "findings": [asdict(finding) for finding in findings(dossier)],
        "systems": [{**asdict(line), "rate": line.rate} for line in verdict_table(dossier)],
        "cases": [case_record(dossier, row) for row in dossier.rows],
        "perception": [asdict(line) for line in perception_costs(dossier)],
        "resources": _resources(content.resources),
    }


def _resources(resources: Resources) -> dict[str, Any]:
    def line(use: Use) -> dict[str, Any]:
        spans = {name: span and asdict(span) for name, span in use.spans.items()}
        return {**{k: v for k, v in asdict(use).items() if k != "spans"}, **spans}

    return {
        "samples": resources.samples,
        "missing": resources.missing or None,
        "batches": [line(use) for use in resources.batches],
        "nodes": [line(use) for use in resources.nodes],
        "total": line(resources.total) if resources.total else None,
    }
