"""The KPI of cases whose search has a formula as its objective."""

from __future__ import annotations

from schemas.kinds.kpi import KpiKind

ROBUSTNESS = "robustness"
"""Name of the scalar."""

KPIS = (
    KpiKind(
        name=ROBUSTNESS,
        place="scalar",
        type="float64",
        doc="Margin by which the formula of a search holds; below 0 it is broken",
        nullable=True,
        label="Robustness",
        digits=3,
        better="more",
    ),
)
"""It is in the results of cases with a formula, and of no others."""
