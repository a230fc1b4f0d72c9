"""A search as a plot: the KPI of its cases in their order, and where they fail."""

from __future__ import annotations

import numpy as np

from conductor.report.pages.content import Content
from conductor.report.plots.parts import Figure, library
from conductor.report.reading.axes import axis_label
from conductor.report.searching.looks import FAILED, HELD, LIMIT
from schemas.files.search_result import FailureMap, SearchFile
from schemas.kinds.kpi import scalars_by_name

_MARKS = {False: {"marker": "o", "color": HELD}, True: {"marker": "x", "color": FAILED}}
"""How a case looks, by whether it failed."""


def search_plot(content: Content, sheet: Figure) -> bool:
    """Draw a search; False: there is none, or nothing has closed yet."""
    found = content.search
    cases = [] if found is None else _cases(found)
    if found is None or not cases:
        return False
    mapped = found.failure_map
    sheet.set_size_inches(9.6 if mapped else 5.2, 3.4)
    panels = sheet.subplots(1, 2 if mapped else 1, squeeze=False)[0]
    _by_order(panels[0], found, [kpi for _, kpi in cases])
    if mapped:
        _by_place(panels[1], found, mapped, cases)
    handles = [
        library("lines").Line2D([], [], linestyle="", label=label, **_MARKS[failed])
        for failed, label in ((False, "held"), (True, "failed"))
    ]
    sheet.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    return True


def _cases(found: SearchFile) -> list[tuple[list[float], float]]:
    """Values and KPI of every case that has one, in the order of proposals; a value that is no
    number is none."""
    return [
        ([float(v) if isinstance(v, int | float) else np.nan for v in values], kpi)
        for _, values, kpi in found.closed()
        if kpi is not None
    ]


def _by_order(panel: Figure, found: SearchFile, kpis: list[float]) -> None:
    failed = np.array([found.fails(kpi) for kpi in kpis])
    for side, marks in _MARKS.items():
        places = np.flatnonzero(failed == side)
        panel.scatter(places, np.array(kpis)[places], s=14, **marks)
    limit = found.fails_below if found.fails_below is not None else found.fails_above
    if limit is not None:
        panel.axhline(limit, color=LIMIT, linestyle="--", linewidth=1)
    kind = scalars_by_name().get(found.kpi)
    panel.set_xlabel("Case, in the order of proposals")
    panel.set_ylabel(f"{found.kpi} [{kind.unit}]" if kind and kind.unit else found.kpi)


def _by_place(
    panel: Figure, found: SearchFile, mapped: FailureMap, cases: list[tuple[list[float], float]]
) -> None:
    """The two parameters that matter most, over the share of cases that fail."""
    share = np.array([[np.nan if z is None else z for z in row] for row in mapped.share])
    if np.isfinite(share).any():
        panel.contourf(
            mapped.x, mapped.y, share, levels=np.linspace(0, 1, 11), cmap="Reds", alpha=0.45
        )
    columns = [found.parameters.index(name) for name in mapped.parameters]
    for side, marks in _MARKS.items():
        places = np.array(
            [[values[c] for c in columns] for values, kpi in cases if found.fails(kpi) is side]
        ).reshape(-1, 2)
        panel.scatter(places[:, 0], places[:, 1], s=14, **marks)
    panel.use_sticky_edges = False  # else points at the edge of the map are cut
    panel.margins(0.04)
    panel.set_xlabel(axis_label(mapped.parameters[0]))
    panel.set_ylabel(axis_label(mapped.parameters[1]))
