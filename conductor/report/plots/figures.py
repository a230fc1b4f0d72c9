"""The frames into which the page's script draws KPI curves: all systems at a glance, or one large.

Everything is plain Plotly JSON. Curves are added by the script, which knows what the reader has
selected; axes, units and the safety line are made here.
"""

from __future__ import annotations

import html
import json
from functools import lru_cache
from typing import Any

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
    layout = _layout(_stacked(names, models) if stacked else _beside(names, models))
    for note in layout["annotations"]:
        note["font"] = {"size": 12, "weight": 600}
    for number in range(len(models)):
        for column, name in enumerate(curves):
            axis = number * len(curves) + column + 1
            _set_range(layout, name, axis, spread=spread)
            look = LOOKS[name]
            if look.scale not in ("switch", "0 to 1") and not (spread and look.share):
                low, high = ranges.get(name, (0.0, 1.0))
                span = [min(low, 0.0), high + 0.04 * (high - low)]
                layout[_key("yaxis", axis)]["range"] = span
            if look.safety_m:
                _safety_line(layout, axis, look.safety_m, labelled=number == 0)
    if not stacked:
        for column in range(len(curves)):
            axis = (len(models) - 1) * len(curves) + column + 1
            layout[_key("xaxis", axis)]["title"] = {"text": time_label}
    return _text(layout, {"l": 36, "r": 26, "t": 98, "b": 48})


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
    layout = _layout(figure)
    # make_subplots centres the titles; a reader looks for them at the left.
    for note in layout["annotations"]:
        note.update(x=0, xanchor="left", font={"size": 13, "weight": 600})
    for index, name in enumerate(curves, 1):
        layout[_key("yaxis", index)]["title"] = {"text": headings[name][1]}
        _set_range(layout, name, index, spread=spread)
        if LOOKS[name].safety_m:
            _safety_line(layout, index, LOOKS[name].safety_m, labelled=True)
    layout[_key("xaxis", len(curves))]["title"] = {"text": time_label}
    layout["height"] = 180 * len(curves)
    return _text(layout, {"l": 72, "r": 12, "t": 98, "b": 48})


def _layout(figure: Any) -> dict[str, Any]:
    """A figure's layout as plain values: Plotly takes milliseconds for every change of its own."""
    layout: dict[str, Any] = figure.layout.to_plotly_json()
    return layout


def _text(layout: dict[str, Any], margin: dict[str, int]) -> str:
    """A figure without traces as JSON."""
    layout |= {"template": _BARE, "margin": margin, "hovermode": "closest", "legend": _LEGEND}
    return json.dumps({"data": [], "layout": layout})


def _key(axis: str, number: int) -> str:
    """Name of an axis; Plotly leaves out a 1."""
    return axis if number == 1 else f"{axis}{number}"


_BARE = {"data": {"scatter": [{"type": "scatter"}]}}
"""Template without looks, in place of Plotly's own."""

# The page's script makes room for it.
_LEGEND = {
    "orientation": "h",
    "yref": "container",
    "y": 1,
    "yanchor": "top",
    "x": 0,
    "itemsizing": "constant",
}


def _set_range(layout: dict[str, Any], name: str, number: int, *, spread: bool) -> None:
    look = LOOKS[name]
    axis: dict[str, Any] = AXES[look.scale]
    if spread and look.share:
        axis = {"range": [0, 1.04], "tickvals": [0, 0.5, 1]}
    layout[_key("yaxis", number)].update(axis)


AXES: dict[str, dict[str, Any]] = {
    "switch": {"range": [-0.08, 1.08], "tickvals": [0, 1]},
    "0 to 1": {"range": [-0.08, 1.08], "tickvals": [0, 0.5, 1]},
    "count": {"rangemode": "tozero", "dtick": 1},
    "signed": {"zeroline": True},
    "from 0": {"rangemode": "tozero"},
}
"""Axes by the scale of a curve."""


def _safety_line(layout: dict[str, Any], number: int, safety_m: float, *, labelled: bool) -> None:
    place = {"xref": f"{_key('x', number)} domain", "yref": _key("y", number)}
    line = {
        **place,
        "type": "line",
        "x0": 0,
        "x1": 1,
        "y0": safety_m,
        "y1": safety_m,
        "line": {"color": _SAFETY_COLOR, "width": 1.5, "dash": "dash"},
    }
    layout.setdefault("shapes", []).append(line)
    if labelled:
        label = {
            **place,
            "text": f"factor of safety {safety_m:g} m",
            "x": 0.004,
            "xanchor": "left",
            "y": safety_m,
            "yanchor": "bottom",
            "showarrow": False,
            "font": {"color": _SAFETY_COLOR, "size": 11},
        }
        layout["annotations"].append(label)


def _plain(text: str) -> dict[str, Any]:
    """A frame of the caller's own."""
    plain: dict[str, Any] = json.loads(text)
    return plain
