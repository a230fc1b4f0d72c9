"""The plot of a boundary that a search has traced."""

from __future__ import annotations

import json
from typing import Any

import plotly.graph_objects as go

from schemas.files.search_result import SearchBoundary, SearchFile

_FAILED, _HELD, _LINE = "#c0392b", "#3a6ea5", "#333333"
_HEIGHT_PX = 520


def boundary_figure(file: SearchFile | None) -> dict[str, Any] | None:
    """The plane of a boundary: its cases, its parts, and the bracket of each of its points; None:
    there is nothing to draw."""
    if file is None or file.boundary is None:
        return None
    boundary, figure = file.boundary, go.Figure()
    _cases(figure, file, boundary)
    _parts(figure, boundary)
    figure.update_xaxes(title={"text": boundary.x})
    figure.update_yaxes(title={"text": boundary.y})
    figure.update_layout(
        template=go.layout.Template(),
        height=_HEIGHT_PX,
        margin={"l": 64, "r": 12, "t": 16, "b": 48},
        hovermode="closest",
        showlegend=False,
    )
    plain: dict[str, Any] = json.loads(figure.to_json())
    return plain


def _cases(figure: go.Figure, file: SearchFile, boundary: SearchBoundary) -> None:
    axes = [file.parameters.index(name) for name in (boundary.x, boundary.y)]
    names, places, kpis = [], [], []
    for generation in file.generations:
        rows = zip(generation.cases, generation.values, generation.results, strict=False)
        for name, values, kpi in rows:
            if kpi is not None:
                names.append(name)
                places.append([values[axis] for axis in axes])
                kpis.append(kpi)
    figure.add_scatter(
        x=[place[0] for place in places],
        y=[place[1] for place in places],
        text=[
            f"<b>{name}</b><br>{file.kpi} {kpi:.4g}" for name, kpi in zip(names, kpis, strict=True)
        ],
        hovertemplate="%{text}<br>%{x:.6g}, %{y:.6g}<extra></extra>",
        mode="markers",
        marker={"size": 5, "color": [_FAILED if file.fails(kpi) else _HELD for kpi in kpis]},
    )


def _parts(figure: go.Figure, boundary: SearchBoundary) -> None:
    """Parts of the boundary as lines, and brackets as bars across them; None parts them."""
    xs: list[float | None] = []
    ys: list[float | None] = []
    for line in boundary.lines:
        xs += [*(boundary.points[number].at[0] for number in line), None]
        ys += [*(boundary.points[number].at[1] for number in line), None]
    figure.add_scatter(
        x=xs, y=ys, mode="lines", line={"color": _LINE, "width": 1.5}, hoverinfo="skip"
    )
    xs, ys = [], []
    for point in boundary.points:
        xs += [point.holds_at[0], point.fails_at[0], None]
        ys += [point.holds_at[1], point.fails_at[1], None]
    figure.add_scatter(
        x=xs, y=ys, mode="lines", line={"color": _LINE, "width": 4}, hoverinfo="skip"
    )
