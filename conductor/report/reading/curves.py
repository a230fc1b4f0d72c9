"""KPI curves of a case, thinned for drawing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from conductor.report.reading.dossier import Dossier
from schemas.kinds.kpi import drawn_columns

LOOKS = {kind.name: kind.curve for kind in drawn_columns() if kind.curve is not None}
"""Looks of the KPI columns that are drawn, from top to bottom."""
CURVES = tuple(LOOKS)

POINTS_MAX = 600
"""Most points per curve of one case."""
POINTS_MIN = 60
"""Fewest points a case is thinned to, however many cases share the page."""
POINTS_TOTAL = 64_000
"""Points of all cases on a page, together; keeps the page of 256 cases below 10 MB."""

SHARED = tuple(name for name, look in LOOKS.items() if look.spread is not None)
"""Columns of which many cases are drawn as a distribution: their lines would fill the panel."""
BINS = 100
"""Stretches of equal length into which the time of a case is cut for distributions."""

Floats = NDArray[np.float32]
"""Numbers as precise as a screen, in half the size."""
_Column = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class KpiCurve:
    """Thinned KPI rows of one case; a missing value is NaN, which draws as a gap."""

    time_s: Floats
    values: dict[str, Floats]
    """Values by column of :data:`CURVES`."""
    ticks: int
    """Rows before thinning."""
    means: dict[str, Floats] = field(default_factory=dict)
    """Means by column of :data:`SHARED`, over each of the :data:`BINS` stretches of the case's
    time, of all rows; NaN where nothing is known."""


def drawn(dossier: Dossier) -> tuple[str, ...]:
    """The curves that the scenario of a campaign fills."""
    return dossier.scenario.report.curves


def overview(dossier: Dossier, curves: Sequence[str]) -> tuple[str, ...]:
    """Columns of ``curves`` that are drawn side by side for all systems under test."""
    chosen = dossier.scenario.report.overview
    return tuple(name for name in curves if name in chosen)


def time_label(dossier: Dossier) -> str:
    """What a case's time is called: that of imported logs is their wall clock."""
    return "Sim time [s]" if dossier.imported is None else "Time in the log [s]"


def points_for(cases: int) -> int:
    """Points per curve when ``cases`` cases share a page."""
    return max(POINTS_MIN, min(POINTS_MAX, POINTS_TOTAL // max(cases, 1)))


def thin(table: pa.Table, points_max: int) -> KpiCurve:
    """Rows of a KPI table, about ``points_max`` at most.

    Kept whatever the number: the first and last row, the row of the smallest distance, both sides
    of every change of a stepped column and of every gap. Between them, the rows that lie furthest
    from straight lines through evenly spaced rows.
    """
    values = {name: _floats(table, name) for name in CURVES}
    time_s = _floats(table, "sim_time_ns") / 1e9
    rows = len(time_s)
    keep = _kept(values, points_max) if rows > points_max else np.arange(rows)
    return KpiCurve(
        _drawn(time_s[keep]),
        {name: _drawn(column[keep]) for name, column in values.items()},
        rows,
        {name: _drawn(_means(time_s, values[name])) for name in SHARED},
    )


def _means(time_s: _Column, column: _Column) -> _Column:
    """Means over :data:`BINS` stretches of equal length; a value holds until the next row."""
    if len(time_s) < 2:
        return np.full(BINS, np.nan)
    edges = np.linspace(time_s[0], time_s[-1], BINS + 1)
    return binned(time_s, column[:-1], edges)


def binned(starts_s: _Column, values: _Column, edges_s: _Column) -> _Column:
    """Means between neighbouring ``edges_s`` of what is constant in stretches.

    Args:
        starts_s: begin of every stretch and the end of the last [s], ascending.
        values: of the stretches, one fewer; NaN: not known.
        edges_s: ascending [s].

    Returns:
        One fewer than ``edges_s``; NaN where nothing is known.
    """
    known = np.isfinite(values)
    lengths = np.diff(starts_s) * known
    integral = np.append(0.0, np.cumsum(np.where(known, values, 0.0) * lengths))
    covered = np.append(0.0, np.cumsum(lengths))
    sums = np.diff(np.interp(edges_s, starts_s, integral))
    parts = np.diff(np.interp(edges_s, starts_s, covered))
    least = 1e-9 * max(float(edges_s[-1] - edges_s[0]), 1e-9)
    return np.where(parts > least, sums / np.maximum(parts, least), np.nan)


def _drawn(values: _Column) -> Floats:
    with np.errstate(over="ignore"):  # a failed case may hold numbers beyond float32
        return values.astype(np.float32)


def _floats(table: pa.Table, name: str) -> _Column:
    """Values of a column [rows], NaN where missing; all are where other families have it."""
    if name not in table.column_names:
        return np.full(table.num_rows, np.nan)
    column = table.column(name)
    if pa.types.is_boolean(column.type):
        column = column.cast(pa.int8())
    values: _Column = column.cast(pa.float64()).to_numpy()
    return values


def _kept(values: dict[str, _Column], points_max: int) -> NDArray[np.intp]:
    rows = len(values["dtc_m"])
    edges = np.zeros(rows, np.bool_)
    for name, column in values.items():
        missing = np.isnan(column)
        changed = np.diff(missing)
        if LOOKS[name].steps:
            # A change out of or into a gap is a change of `missing`; NaN != NaN is none.
            changed |= (np.diff(column) != 0) & ~missing[1:] & ~missing[:-1]
        edges[:-1] |= changed
        edges[1:] |= changed
    changes = np.flatnonzero(edges)
    if len(changes) > points_max // 2:
        # A column that flickers at every tick: an even choice is all that fits.
        changes = changes[np.linspace(0, len(changes) - 1, points_max // 2).astype(np.intp)]
    must = np.union1d(changes, [0, rows - 1])
    if not np.isnan(values["dtc_m"]).all():
        must = np.union1d(must, [np.nanargmin(values["dtc_m"])])
    free = max(points_max - len(must), 2)
    return np.union1d(must, _bent(values, free)).astype(np.intp)


def _bent(values: dict[str, _Column], count: int) -> NDArray[np.intp]:
    """Rows, about ``count``: evenly spaced ones, and between each two the one furthest from the
    straight line between them."""
    rows = len(values["dtc_m"])
    anchors = np.unique(np.linspace(0, rows - 1, max(count // 2, 2)).astype(np.intp))
    index = np.arange(rows)
    distance = np.zeros(rows)
    for column in values.values():
        filled = np.nan_to_num(column)
        span = np.ptp(filled)
        if span > 0:
            line = np.interp(index, anchors, filled[anchors])
            distance = np.maximum(distance, np.abs(filled - line) / span)
    bucket = np.searchsorted(anchors, index, side="right")
    order = np.lexsort((distance, bucket))
    last = np.flatnonzero(np.diff(bucket[order], append=-1))
    return np.union1d(anchors, order[last])
