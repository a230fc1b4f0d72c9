"""The frames into which the page's script draws KPI curves: all systems at a glance, or one large.

Everything is plain Plotly JSON. Curves are added by the script, which knows what the reader has
selected; axes, units and the safety line are made here.
"""

from __future__ import annotations

import html
import json
from functools import lru_cache
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from conductor.report.reading.curves import LOOKS

GRID_ROWS_MAX = 8
"""Most systems under test in the figure of all."""
FRAMES_KEPT = 8
"""Frames that are remembered: a process that reports again and again makes the same ones, and they
take most of the time of a page."""

_SAFETY_COLOR = "#B3261E"
_GRID_ROW_PX = 170


def titles(*, spread: bool) -> dict[str, tuple[str, str]]:
    """Title of a curve's row, title of its axis; ``spread``: of distributions over many cases."""
    return {
        name: look.spread if spread and look.spread else (look.title, look.axis)
        for name, look in LOOKS.items()
    }


def column_title(name: str, *, spread: bool) -> str:
    """Title and unit of a curve in one."""
    title, axis = titles(spread=spread)[name]
    return f"{title} [{axis.rpartition('[')[2]}"


def grid_frame(
    curves: tuple[str, ...],
    models: list[str],
    ranges: dict[str, tuple[float, float]],
    time_label: str,
    *,
    spread: bool = False,
    stacked: bool = False,
) -> dict[str, Any]:
    """The paper's Fig. 5 without traces: a row per system under test, a column per KPI.

    Axis ``y<row * len(curves) + column + 1>`` belongs to a model and a curve. ``ranges`` holds the
    least and most value of each curve: systems share it, so that they can be compared. ``spread``:
    of many cases. ``stacked``: all panels below each other, for narrow screens.
    """
    told = tuple(ranges.items())
    return _plain(_grid_text(curves, tuple(models), told, time_label, spread, stacked))


@lru_cache(FRAMES_KEPT)
def _grid_text(
    curves: tuple[str, ...],
    systems: tuple[str, ...],
    told: tuple[tuple[str, tuple[float, float]], ...],
    time_label: str,
    spread: bool,
    stacked: bool,
) -> str:
    ranges = dict(told)
    names = [column_title(name, spread=spread) for name in curves]
    models = [html.escape(model, quote=False) for model in systems]
    figure = _stacked(names, models) if stacked else _beside(names, models)
    for note in figure.layout.annotations:
        note.update(font={"size": 12, "weight": 600})
    for number in range(len(models)):
        for column, name in enumerate(curves, 1):
            row, col = (number * len(curves) + column, 1) if stacked else (number + 1, column)
            _set_range(figure, name, row, col, spread=spread)
            look = LOOKS[name]
            if look.scale not in ("switch", "0 to 1") and not (spread and look.share):
                low, high = ranges.get(name, (0.0, 1.0))
                span = [min(low, 0.0), high + 0.04 * (high - low)]
                figure.update_yaxes(range=span, row=row, col=col)
            if look.safety_m:
                _safety_line(figure, row, col, look.safety_m, labelled=number == 0)
    if not stacked:
        figure.update_xaxes(title={"text": time_label}, row=len(models))
    figure.update_layout(
        template=go.layout.Template(),
        margin={"l": 36, "r": 26, "t": 98, "b": 48},
        hovermode="closest",
        legend=_LEGEND,
    )
    return str(figure.to_json())


def _beside(names: list[str], models: list[str]) -> Any:
    rows = len(models)
    figure = make_subplots(
        rows=rows,
        cols=len(names),
        shared_xaxes="all",
        shared_yaxes="columns",
        horizontal_spacing=0.03,
        vertical_spacing=0.14 / rows,
        column_titles=names,
        row_titles=models,
    )
    return figure.update_layout(height=150 + _GRID_ROW_PX * rows)


def _stacked(names: list[str], models: list[str]) -> Any:
    rows = len(names) * len(models)
    figure = make_subplots(
        rows=rows,
        cols=1,
        vertical_spacing=0.36 / rows,
        subplot_titles=[f"{model}<br>{name}" for model in models for name in names],
    )
    for note in figure.layout.annotations:
        note.update(x=0, xanchor="left", align="left")
    figure.update_xaxes(matches="x").update_layout(xaxis_matches=None)
    return figure.update_layout(height=150 + _GRID_ROW_PX * rows)


def curve_frame(
    curves: tuple[str, ...], time_label: str, *, spread: bool = False
) -> dict[str, Any]:
    """Layout of the curve figure: one row per KPI over a shared time axis, without traces.

    Axis ``y<n>`` belongs to the n-th of ``curves``. ``spread``: of many cases.
    """
    return _plain(_curve_text(curves, time_label, spread))


@lru_cache(FRAMES_KEPT)
def _curve_text(curves: tuple[str, ...], time_label: str, spread: bool) -> str:
    headings = titles(spread=spread)
    figure = make_subplots(
        rows=len(curves),
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.035,
        row_heights=[LOOKS[name].height for name in curves],
        subplot_titles=[headings[name][0] for name in curves],
    )
    # make_subplots centres the titles; a reader looks for them at the left.
    for note in figure.layout.annotations:
        note.update(x=0, xanchor="left", font={"size": 13, "weight": 600})
    for index, name in enumerate(curves, 1):
        figure.update_yaxes(title={"text": headings[name][1]}, row=index, col=1)
        _set_range(figure, name, index, 1, spread=spread)
        if LOOKS[name].safety_m:
            _safety_line(figure, index, 1, LOOKS[name].safety_m, labelled=True)
    figure.update_xaxes(title={"text": time_label}, row=len(curves), col=1)
    figure.update_layout(
        template=go.layout.Template(),
        height=180 * len(curves),
        margin={"l": 72, "r": 12, "t": 98, "b": 48},
        hovermode="closest",
        legend=_LEGEND,
    )
    return str(figure.to_json())


# The page's script makes room for it.
_LEGEND = {
    "orientation": "h",
    "yref": "container",
    "y": 1,
    "yanchor": "top",
    "x": 0,
    "itemsizing": "constant",
}


def _set_range(figure: Any, name: str, row: int, column: int, *, spread: bool) -> None:
    look = LOOKS[name]
    axis: dict[str, Any] = _AXES[look.scale]
    if spread and look.share:
        axis = {"range": [0, 1.04], "tickvals": [0, 0.5, 1]}
    figure.update_yaxes(**axis, row=row, col=column)


_AXES: dict[str, dict[str, Any]] = {
    "switch": {"range": [-0.08, 1.08], "tickvals": [0, 1]},
    "0 to 1": {"range": [-0.08, 1.08], "tickvals": [0, 0.5, 1]},
    "count": {"rangemode": "tozero", "dtick": 1},
    "signed": {"zeroline": True},
    "from 0": {"rangemode": "tozero"},
}
"""Axes by the scale of a curve."""


def _safety_line(figure: Any, row: int, column: int, safety_m: float, *, labelled: bool) -> None:
    figure.add_shape(
        type="line",
        xref="x domain",
        x0=0,
        x1=1,
        y0=safety_m,
        y1=safety_m,
        line={"color": _SAFETY_COLOR, "width": 1.5, "dash": "dash"},
        row=row,
        col=column,
    )
    if labelled:
        figure.add_annotation(
            text=f"factor of safety {safety_m:g} m",
            xref="x domain",
            x=0.004,
            xanchor="left",
            y=safety_m,
            yanchor="bottom",
            showarrow=False,
            font={"color": _SAFETY_COLOR, "size": 11},
            row=row,
            col=column,
        )


def _plain(text: str) -> dict[str, Any]:
    """A frame of the caller's own."""
    plain: dict[str, Any] = json.loads(text)
    return plain
