"""Which pairs of values a campaign without a search has never tried together."""

from __future__ import annotations

import numpy as np
from msgspec import UNSET

from conductor.report.reading.axes import axis_value, axis_values, varied_axes
from conductor.report.reading.dossier import Dossier
from conductor.search.answers.coverage import Axis, coverage_of
from schemas.files.search_result import SearchCoverage
from schemas.sections.search import CELLS_MAX

_NO_DOMAIN = ("repeat",)
"""Axes that decide nothing but random numbers."""


def grid_coverage(dossier: Dossier) -> SearchCoverage | None:
    """What the cases with a verdict tried of the values of the matrix, every value as likely as any
    other; None: every pair was tried, or it is a search, a rulebook or imported, or has not ended.

    Axes with more than :data:`schemas.sections.search.CELLS_MAX` values are left out.
    """
    campaign = dossier.campaign
    other = campaign.search is not UNSET or campaign.rulebook is not UNSET
    if other or dossier.imported is not None or not dossier.outcomes.complete:
        return None
    rows = [row for row in dossier.rows if row.end.outcome == "verdict"]
    axes = []
    for name in varied_axes(dossier):
        values = axis_values(dossier, name)
        if name not in campaign.matrix or name in _NO_DOMAIN or len(values) > CELLS_MAX:
            continue
        places = {value: place for place, value in enumerate(values)}
        cells = np.array([places[axis_value(row.case, name)] for row in rows], np.intp)
        weights = np.full(len(values), 1.0 / len(values))
        axes.append(Axis(name, [str(value) for value in values], weights, cells))
    found = coverage_of(axes) if len(axes) > 1 else None
    return found if found is not None and found.untried else None
