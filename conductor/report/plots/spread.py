"""Spread of a KPI over many cases as time goes on: drawn where lines would fill the panel."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from conductor.report.reading.curves import BINS, LOOKS, SHARED, Floats, KpiCurve, binned

LINES_MAX = 24
"""Most cases of a panel whose switches are drawn as lines."""
LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Quantiles of a command, the median in the middle."""
SHARES = tuple(name for name, look in LOOKS.items() if look.share)
"""Columns of which the share of cases is drawn instead of quantiles."""
_LEAST = 0.25
"""Least share of cases that still run; where fewer do, nothing is drawn of them [-]."""


@dataclass(frozen=True, slots=True)
class Spread:
    """Distributions over the cases of one system under test."""

    cases: int
    time_s: Floats
    """Middles of the stretches of time."""
    values: dict[str, Floats]
    """Values by column of :data:`~conductor.report.reading.curves.SHARED`. ``aeb``: share of the
    running cases [1, BINS]; ``collisions``: share of all cases that have collided by then [1,
    BINS]; ``throttle`` and ``brake``: the quantiles :data:`LEVELS` over the running cases [5,
    BINS]. All 0 to 1; NaN: too few cases run."""


def spread_of(curves: Sequence[KpiCurve]) -> Spread | None:
    """Distributions over ``curves``; None: they are few enough to be drawn one by one."""
    timed = [curve for curve in curves if len(curve.time_s) > 1]
    if len(timed) <= LINES_MAX:
        return None
    end_s = max(float(curve.time_s[-1]) for curve in timed)
    edges = np.linspace(0.0, end_s, BINS + 1)
    values = {name: _over_cases(name, timed, edges) for name in SHARED}
    return Spread(
        cases=len(timed),
        time_s=(0.5 * (edges[1:] + edges[:-1])).astype(np.float32),
        values={name: rows.astype(np.float32) for name, rows in values.items()},
    )


def _over_cases(
    name: str, curves: list[KpiCurve], edges: NDArray[np.float64]
) -> NDArray[np.float64]:
    if name == "collisions":
        return _collided(curves, edges)[None]
    rows = np.stack([_row(curve, name, edges) for curve in curves])
    few = np.isfinite(rows).sum(axis=0) < max(1.0, _LEAST * len(rows))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a stretch in which nothing is known
        distribution = (
            np.nanmean(rows, axis=0)[None]
            if name in SHARES
            else np.nanquantile(rows, LEVELS, axis=0)
        )
    distribution[:, few] = np.nan
    return distribution


def _row(curve: KpiCurve, name: str, edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means of a case over the stretches that all cases share."""
    case_edges = np.linspace(float(curve.time_s[0]), float(curve.time_s[-1]), BINS + 1)
    return binned(case_edges, curve.means[name].astype(np.float64), edges)


def _collided(curves: list[KpiCurve], edges: NDArray[np.float64]) -> NDArray[np.float64]:
    known = [curve for curve in curves if np.isfinite(curve.values["collisions"]).any()]
    if not known:
        return np.full(BINS, np.nan)
    hits = [curve.time_s[curve.values["collisions"] > 0][:1] for curve in known]
    times = np.sort(np.concatenate(hits))
    return np.searchsorted(times, edges[1:], side="right") / len(known)
