"""The figures of the page: heat maps of verdicts, and the frame into which curves are drawn.

Everything is plain Plotly JSON. Curves are added by the page's script, which knows what the reader
has selected; the frame (axes, units, the safety line) is made here.
"""

from __future__ import annotations

import html
import json
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from conductor.report.axes import axis_label, axis_values, heat_axes
from conductor.report.cells import cell_text, cells_of, worst
from conductor.report.curves import CURVES
from conductor.report.dossier import Dossier, Row
from conductor.report.palette import status_color
from conductor.report.tables import statuses

SAFETY_M = 1.0
"""Factor of safety of the paper's Fig. 5 [m]."""

TITLES = {
    "aeb": ("AEB trigger", "AEB [0/1]"),
    "dtc_m": ("Distance to collision", "DTC [m]"),
    "collisions": ("Collisions so far", "count [-]"),
    "throttle": ("Throttle command", "throttle [-]"),
    "brake": ("Brake command", "brake [-]"),
    "speed_mps": ("Speed", "speed [m/s]"),
}
"""Curve -> title of its row, title of its axis."""

_SAFETY_COLOR = "#B3261E"

_CASES_IN_HOVER = 6
_ROW_HEIGHTS = {"aeb": 0.6, "dtc_m": 1.6, "collisions": 0.6, "speed_mps": 1.2}


def heat_maps(dossier: Dossier) -> list[dict[str, Any]]:
    """One heat map of verdicts per model, as Plotly JSON with the model's name as ``title``."""
    x_axis, y_axis = heat_axes(dossier)
    if "model" in (x_axis, y_axis):
        return [{"title": "All models", **_heat_map(dossier, dossier.rows, x_axis, y_axis)}]
    maps = []
    for model in axis_values(dossier, "model"):
        rows = [row for row in dossier.rows if row.case.model == model]
        maps.append({"title": model, **_heat_map(dossier, rows, x_axis, y_axis)})
    return maps


def _heat_map(dossier: Dossier, rows: list[Row], x_axis: str, y_axis: str) -> dict[str, Any]:
    cells = cells_of(dossier, rows, x_axis, y_axis)
    xs, ys, grid = cells.xs, cells.ys, cells.rows
    known = statuses(dossier)
    count = len(known)
    scale = []
    for index, status in enumerate(known):
        scale += [
            [index / count, status_color(status)],
            [(index + 1) / count, status_color(status)],
        ]
    figure = go.Figure(
        go.Heatmap(
            x=[_tick(x) for x in xs],
            y=[_tick(y) for y in ys],
            z=[[known.index(worst(c).status) if c else None for c in line] for line in grid],
            text=[[cell_text(c) for c in line] for line in grid],
            hovertext=[[_hover(c) for c in line] for line in grid],
            customdata=[[worst(c).case.id if c else "" for c in line] for line in grid],
            texttemplate="%{text}",
            hovertemplate="%{hovertext}<extra></extra>",
            hoverongaps=False,
            zmin=-0.5,
            zmax=count - 0.5,
            colorscale=scale,
            showscale=False,
            xgap=2,
            ygap=2,
        )
    )
    figure.update_layout(
        template=go.layout.Template(),
        height=max(170, 92 + 34 * len(ys)),
        margin={"l": 96, "r": 8, "t": 8, "b": 52},
        xaxis={"title": {"text": axis_label(x_axis)}, "type": "category", "showgrid": False},
        yaxis={
            "title": {"text": axis_label(y_axis), "standoff": 14},
            "type": "category",
            "autorange": "reversed",
            "showgrid": False,
        },
    )
    return _plain(figure)


def _tick(value: object) -> str:
    return html.escape(str(value).replace("_", " "), quote=False)


def _hover(cell: list[Row]) -> str:
    lines = []
    for row in cell[:_CASES_IN_HOVER]:
        lines.append(f"<b>{html.escape(row.case.id, quote=False)}</b>")
        lines.append(html.escape(row.status.replace("_", " "), quote=False))
        distance, speed = row.scalar("dtc_min_m"), row.scalar("impact_speed_mps")
        if distance is not None:
            lines.append(f"smallest distance {distance:.3f} m")
        if speed is not None:
            lines.append(f"impact at {speed:.2f} m/s")
        lines += [html.escape(_short(reason), quote=False) for reason in row.end.reasons[:2]]
    if len(cell) > _CASES_IN_HOVER:
        lines.append(f"and {len(cell) - _CASES_IN_HOVER} more")
    return "<br>".join(lines)


def _short(text: str) -> str:
    return text if len(text) <= 90 else text[:89] + "…"


def curve_frame() -> dict[str, Any]:
    """Layout of the curve figure: one row per KPI over a shared sim time axis, without traces.

    Axis ``y<n>`` belongs to the n-th of :data:`CURVES`.
    """
    figure = make_subplots(
        rows=len(CURVES),
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.035,
        row_heights=[_ROW_HEIGHTS.get(name, 0.8) for name in CURVES],
        subplot_titles=[TITLES[name][0] for name in CURVES],
    )
    # make_subplots centres the titles; a reader looks for them at the left.
    for note in figure.layout.annotations:
        note.update(x=0, xanchor="left", font={"size": 13, "weight": 600})
    for index, name in enumerate(CURVES, 1):
        figure.update_yaxes(title={"text": TITLES[name][1]}, row=index, col=1)
        if name in ("aeb", "throttle", "brake"):
            figure.update_yaxes(range=[-0.08, 1.08], tickvals=[0, 0.5, 1], row=index, col=1)
        elif name == "collisions":
            figure.update_yaxes(rangemode="tozero", dtick=1, row=index, col=1)
        else:
            figure.update_yaxes(rangemode="tozero", row=index, col=1)
    figure.update_yaxes(tickvals=[0, 1], row=CURVES.index("aeb") + 1, col=1)
    row = CURVES.index("dtc_m") + 1
    figure.add_shape(
        type="line",
        xref="x domain",
        x0=0,
        x1=1,
        y0=SAFETY_M,
        y1=SAFETY_M,
        line={"color": _SAFETY_COLOR, "width": 1.5, "dash": "dash"},
        row=row,
        col=1,
    )
    figure.add_annotation(
        text=f"factor of safety {SAFETY_M:g} m",
        xref="x domain",
        x=0.004,
        xanchor="left",
        y=SAFETY_M,
        yanchor="bottom",
        showarrow=False,
        font={"color": _SAFETY_COLOR, "size": 11},
        row=row,
        col=1,
    )
    figure.update_xaxes(title={"text": "Sim time [s]"}, row=len(CURVES), col=1)
    figure.update_layout(
        template=go.layout.Template(),
        height=1080,
        margin={"l": 72, "r": 12, "t": 98, "b": 48},
        hovermode="closest",
        # Below the tool bar, above the first row, whatever the height.
        legend={
            "orientation": "h",
            "yref": "container",
            "y": 0.97,
            "yanchor": "top",
            "x": 0,
            "itemsizing": "constant",
        },
    )
    return _plain(figure)


def _plain(figure: Any) -> dict[str, Any]:
    plain: dict[str, Any] = json.loads(figure.to_json())
    return plain
