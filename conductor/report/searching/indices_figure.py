"""Which parameters matter, as bars with intervals."""

from __future__ import annotations

import json
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from conductor.report.reading.axes import axis_label
from schemas.files.search_result import SearchIndices, SensitivityIndex

FIRST, TOTAL = "#3a6ea5", "#b8860b"
PARAMETERS_MAX = 20
"""Most parameters that are drawn, those that matter most."""
_ROW_PX, _AROUND_PX = 34, 110


def indices_figure(indices: SearchIndices | None, kpi: str) -> dict[str, Any] | None:
    """Bars of a search's indices, a panel for the KPI's value and one for failure; None: there are
    none."""
    parts = (
        [] if indices is None else [("Value of " + kpi, indices.kpi), ("Failure", indices.failure)]
    )
    parts = [(title, part) for title, part in parts if part]
    if not parts:
        return None
    figure = make_subplots(
        rows=1,
        cols=len(parts),
        shared_yaxes=True,
        horizontal_spacing=0.04,
        subplot_titles=[title for title, _ in parts],
    )
    order = sorted(parts[-1][1], key=_weight, reverse=True)[:PARAMETERS_MAX]
    names = [index.parameter for index in order]
    for column, (_, part) in enumerate(parts, start=1):
        by_name = {index.parameter: index for index in part}
        _bars(figure, [by_name[name] for name in names], column)
    figure.update_xaxes(range=[-0.02, 1.02], title={"text": "Share of the variance"})
    figure.update_yaxes(autorange="reversed")
    both = order[0].total is not None
    figure.update_layout(
        template=go.layout.Template(),
        height=_AROUND_PX + _ROW_PX * len(order) * (2 if both else 1),
        margin={"l": 64, "r": 12, "t": 40, "b": 48},
        barmode="group",
        showlegend=both,
    )
    plain: dict[str, Any] = json.loads(figure.to_json())
    return plain


def ranked(indices: SearchIndices | None) -> list[str]:
    """Parameters, those that matter most first: for failures, where that is known."""
    if indices is None:
        return []
    part = indices.failure or indices.kpi
    return [index.parameter for index in sorted(part, key=_weight, reverse=True)]


def _weight(index: SensitivityIndex) -> float:
    return index.first if index.total is None else index.total


def _bars(figure: go.Figure, part: list[SensitivityIndex], column: int) -> None:
    labels = [axis_label(index.parameter) for index in part]
    firsts = [(i.first, i.first_low, i.first_high) for i in part]
    orders = [("First order: alone", FIRST, firsts)]
    if part[0].total is not None:
        totals = [(i.total or 0.0, i.total_low or 0.0, i.total_high or 0.0) for i in part]
        orders.append(("Total order: with others", TOTAL, totals))
    for name, color, bars in orders:
        figure.add_bar(
            name=name,
            x=[value for value, _, _ in bars],
            y=labels,
            orientation="h",
            marker={"color": color},
            error_x={
                "type": "data",
                "symmetric": False,
                "array": [max(0.0, high - value) for value, _, high in bars],
                "arrayminus": [max(0.0, value - low) for value, low, _ in bars],
                "color": "#888888",
            },
            hovertemplate="%{y}: %{x:.3f}<extra></extra>",
            showlegend=column == 1,
            row=1,
            col=column,
        )
