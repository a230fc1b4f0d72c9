"""What the page and the data are made of: the dossier, with its KPI files read and checked."""

from __future__ import annotations

from dataclasses import dataclass

from conductor.report.curves import Curve, points_for, read_curve
from conductor.report.dossier import Dossier, Row
from conductor.report.evidence import Evidence, gather
from conductor.report.resources import read_resources
from conductor.report.resources_use import Resources, no_resources, resources_of
from twin.fabric.errors import InfrastructureError

CASES_MAX = 2000
"""Most cases with a table row and curves; a larger campaign shows its worst first."""


@dataclass(frozen=True, slots=True)
class Content:
    """A dossier with everything that was read and checked for it."""

    dossier: Dossier
    shown: list[Row]
    """Cases with a table row and curves, in campaign order."""
    curves: dict[str, Curve]
    evidence: Evidence
    resources: Resources


def read_content(dossier: Dossier) -> Content:
    """Read and check every KPI file; keep the curves of the cases that are shown."""
    order = sorted(range(len(dossier.rows)), key=lambda i: dossier.rows[i].passed is True)
    shown = {dossier.rows[i].case.id for i in order[:CASES_MAX]}
    points = points_for(len(shown))
    curves: dict[str, Curve] = {}
    broken: list[str] = []
    for row in dossier.rows:
        try:
            curve = read_curve(dossier, row, points)
        except InfrastructureError as error:
            broken.append(str(error))
            continue
        if curve is not None and row.case.id in shown:
            curves[row.case.id] = curve
    rows = [row for row in dossier.rows if row.case.id in shown]
    return Content(dossier, rows, curves, gather(dossier, broken), _resources(dossier))


def _resources(dossier: Dossier) -> Resources:
    """Results stand without them, so a damaged file is told in their section, not as an alarm."""
    try:
        return resources_of(dossier, read_resources(dossier.folder))
    except InfrastructureError as error:
        return no_resources(str(error))
