"""KPIs that follow from the rows of a case alone, by the functions that declarations name."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from schemas.kinds.kpi import KpiKind
from schemas.kinds.registry import implementation
from twin.scenario.protocol import Rows, Scalars


def computed_column(kind: KpiKind, rows: Rows) -> np.ndarray:
    """Values of a column, float64 [rows]; NaN where missing.

    Raises:
        ValueError: its function cannot be imported, or gives something else; one line.
    """
    values = np.asarray(implementation(kind.implementation)(rows), np.float64)
    if values.shape != (rows.rows,):
        raise ValueError(
            f"KPI column '{kind.name}': {kind.implementation} gives values of shape "
            f"{values.shape}, allowed: one per row, ({rows.rows},)"
        )
    return values


def computed_scalars(kinds: Iterable[KpiKind], rows: Rows) -> Scalars:
    """Scalars among ``kinds`` that have a function; None where missing.

    Raises:
        ValueError: a function cannot be imported; one line.
    """
    scalars: Scalars = {}
    for kind in kinds:
        if kind.implementation:
            value = implementation(kind.implementation)(rows)
            scalars[kind.name] = None if value is None or not math.isfinite(value) else float(value)
    return scalars
