"""The KPI rows of one finished case, as plain NumPy columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from schemas.files.kpi import DETECTION_FIELDS, KPI_COLUMNS


@dataclass(frozen=True, slots=True)
class KpiColumn:
    """One column of n rows."""

    values: np.ndarray
    """[n] of the column's type; 0, or an empty text, where not valid."""
    valid: np.ndarray | None
    """bool [n]; None where a column is never missing."""


@dataclass(frozen=True, slots=True)
class DetectionColumn:
    """The ragged column: the detections of row i are entries ``offsets[i]:offsets[i + 1]``."""

    offsets: np.ndarray
    """int32 [n + 1]"""
    valid: np.ndarray
    """bool [n]; False: there was no command."""
    label: list[str]
    confidence: np.ndarray
    x_px: np.ndarray
    y_px: np.ndarray
    width_px: np.ndarray
    height_px: np.ndarray


@dataclass(frozen=True, slots=True)
class KpiTable:
    """Columns in the order of :data:`schemas.files.kpi.KPI_COLUMNS`, without ``detections``; behind
    them those of the scenario's family."""

    rows: int
    columns: dict[str, KpiColumn]
    detections: DetectionColumn

    def to_lists(self) -> dict[str, list[Any]]:
        """Columns of plain Python values, None where missing; detections are lists of dicts."""
        lists: dict[str, list[Any]] = {}
        for name in dict.fromkeys((*(column.name for column in KPI_COLUMNS), *self.columns)):
            if name not in self.columns:
                lists[name] = self._detection_rows()
                continue
            data = self.columns[name]
            values = data.values.tolist()
            if data.valid is not None:
                values = [v if ok else None for v, ok in zip(values, data.valid, strict=True)]
            lists[name] = values
        return lists

    def _detection_rows(self) -> list[list[dict[str, Any]] | None]:
        d = self.detections
        flat = [
            dict(zip(DETECTION_FIELDS, entry, strict=True))
            for entry in zip(
                d.label,
                d.confidence.tolist(),
                d.x_px.tolist(),
                d.y_px.tolist(),
                d.width_px.tolist(),
                d.height_px.tolist(),
                strict=True,
            )
        ]
        return [
            flat[d.offsets[i] : d.offsets[i + 1]] if d.valid[i] else None for i in range(self.rows)
        ]
