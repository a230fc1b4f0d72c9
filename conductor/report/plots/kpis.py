"""The plot of KPIs over sim time, the paper's Fig. 5: a row per system under test."""

from __future__ import annotations

import numpy as np

from conductor.report.pages.content import Content
from conductor.report.plots.figures import GRID_ROWS_MAX, column_title
from conductor.report.plots.palette import line_styles, status_color
from conductor.report.plots.parts import (
    LEGEND_ROW_IN,
    RASTER_LINES,
    Figure,
    legend,
    library,
    words,
    wrapped,
)
from conductor.report.plots.spread import SHARES, Spread, spread_of
from conductor.report.reading.axes import axis_value, axis_values, varied_axes
from conductor.report.reading.curves import LOOKS, KpiCurve, drawn, overview, time_label
from conductor.report.reading.dossier import CaseRow
from conductor.report.reading.systems import system_names

LINES_MAX = 400
"""Most cases with curves, of all systems under test together: of each the first ones."""
_PANEL_IN = (2.9, 1.7)
"""Width and height of a panel [inches]."""
_INK = "#3B4754"


def kpis_plot(content: Content, sheet: Figure) -> bool:
    """A row per system under test, a column per KPI; a line per case, or of many cases how they
    are spread. False: there is nothing to draw."""
    dossier = content.dossier
    names = list(overview(dossier, drawn(dossier)))
    systems = dict(list(system_names(dossier).items())[:GRID_ROWS_MAX])
    with_curve = [row for row in content.shown if row.case.id in content.curves]
    by_model = {m: [row for row in with_curve if row.case.variation.model == m] for m in systems}
    if not any(by_model.values()):
        return False
    spreads = {m: _spread(content, rows) for m, rows in by_model.items()}
    many = any(spread is not None for spread in spreads.values())
    axis = "weather" if "weather" in varied_axes(dossier) else "model"
    styles = line_styles(axis, axis_values(dossier, axis))
    wide_in, high_in = _PANEL_IN
    sheet.set_size_inches(wide_in * len(names), 0.6 + LEGEND_ROW_IN + high_in * len(systems))
    panels = sheet.subplots(len(systems), len(names), squeeze=False, sharex=True, sharey="col")
    for line, (model, system) in enumerate(systems.items()):
        shown_rows = by_model[model][: LINES_MAX // len(systems)]
        colors = [styles[str(axis_value(row.case, axis))][0] for row in shown_rows]
        curves = [content.curves[row.case.id] for row in shown_rows]
        spread = spreads[model]
        for name, panel in zip(names, panels[line], strict=True):
            if spread is not None and name in spread.values:
                _draw_spread(panel, name, spread)
            else:
                _draw_lines(panel, name, curves, colors)
        total = sum(row.case.variation.model == model for row in dossier.rows)
        cut = (
            f"\n{len(shown_rows)} of {total} cases"
            if len(shown_rows) < len(by_model[model])
            else ""
        )
        panels[line][0].set_ylabel(f"{wrapped(system, high_in)}{cut}")
    for name, top, bottom in zip(names, panels[0], panels[-1], strict=True):
        top.set_title(column_title(name, spread=many), fontsize=9)
        bottom.set_xlabel(time_label(dossier))
        _limit(top, name, share=many and name in SHARES)
    labels = system_names(dossier) if axis == "model" else {}
    legend(sheet, {labels.get(v, words(v)): style[0] for v, style in styles.items()})
    return True


def _spread(content: Content, rows: list[CaseRow]) -> Spread | None:
    return spread_of([content.curves[row.case.id] for row in rows])


def _draw_lines(panel: Figure, name: str, curves: list[KpiCurve], colors: list[str]) -> None:
    panel.add_collection(
        library("collections").LineCollection(
            [np.column_stack([curve.time_s, curve.values[name]]) for curve in curves],
            colors=colors,
            linewidths=0.7,
            rasterized=len(curves) > RASTER_LINES,
            # A line at 0 is seen on the axis.
            clip_on=False,
            zorder=3,
        )
    )
    panel.autoscale_view()
    if LOOKS[name].safety_m:
        panel.axhline(LOOKS[name].safety_m, color="#B3261E", lw=0.8, ls="--")


def _draw_spread(panel: Figure, name: str, spread: Spread) -> None:
    rows = spread.values[name]
    ink = status_color("collision") if name == "collisions" else _INK
    if len(rows) == 1:
        panel.fill_between(spread.time_s, rows[0], color=ink, alpha=0.25, lw=0)
        panel.plot(spread.time_s, rows[0], color=ink, lw=1.2)
        return
    panel.fill_between(spread.time_s, rows[0], rows[4], color=ink, alpha=0.16, lw=0)
    panel.fill_between(spread.time_s, rows[1], rows[3], color=ink, alpha=0.32, lw=0)
    panel.plot(spread.time_s, rows[2], color=ink, lw=1.4)


def _limit(panel: Figure, name: str, *, share: bool) -> None:
    """Nothing is drawn below 0 but what can be negative; limits are those of the whole column."""
    scale = LOOKS[name].scale
    if scale in ("switch", "0 to 1") or share:
        panel.set_ylim(0, 1.04)
    elif scale != "signed":
        top = panel.get_ylim()[1]
        panel.set_ylim(0, max(top, 1.04) if scale == "count" else top)
    if scale == "count" and not share:
        panel.yaxis.get_major_locator().set_params(integer=True)
