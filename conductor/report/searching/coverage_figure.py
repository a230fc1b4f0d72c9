"""What was tried of a domain, as heat maps of pairs of parameters."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from conductor.report.reading.axes import axis_label
from conductor.search.answers.coverage import POSSIBLE_MIN
from schemas.files.search_result import CoveredPair, SearchCoverage

PARAMETERS_MAX = 5
"""Most parameters that are drawn, each with each other."""
_TRIED = [[0.0, "#d6e4f0"], [1.0, "#1f4e79"]]
_UNTRIED = [[0.0, "#fbe3df"], [1.0, "#c0392b"]]
_PANEL_PX, _AROUND_PX = 190, 110


def coverage_figure(
    coverage: SearchCoverage | None, first: Sequence[str] = ()
) -> dict[str, Any] | None:
    """Heat maps of pairs, blue by cases and red by the probability of what was not tried; None:
    there is no pair. ``first``: parameters that are drawn before others."""
    if coverage is None or not coverage.pairs:
        return None
    cells = {p.parameter: [html.escape(cell) for cell in p.cells] for p in coverage.parameters}
    names = [*(name for name in first if name in cells), *(n for n in cells if n not in first)]
    names = sorted(names[:PARAMETERS_MAX], key=list(cells).index)
    pairs = {tuple(sorted(pair.parameters)): pair for pair in coverage.pairs}
    figure = make_subplots(
        rows=len(names) - 1,
        cols=len(names) - 1,
        shared_xaxes=True,
        shared_yaxes=True,
        horizontal_spacing=0.02,
        vertical_spacing=0.02,
    )
    most = max((max(map(max, pair.cases)) for pair in coverage.pairs), default=1)
    for row, y in enumerate(names[1:], start=1):
        for column, x in enumerate(names[:row], start=1):
            pair = pairs[tuple(sorted((x, y)))]
            _panel(figure, pair, (x, y), (cells[x], cells[y]), most, (row, column))
            if column == 1:
                figure.update_yaxes(
                    title={"text": axis_label(y), "standoff": 8}, row=row, col=column
                )
            if row == len(names) - 1:
                figure.update_xaxes(title={"text": axis_label(x)}, row=row, col=column)
    figure.update_xaxes(type="category", tickangle=-45, showgrid=False, tickfont={"size": 9})
    figure.update_yaxes(type="category", showgrid=False, tickfont={"size": 9})
    figure.update_layout(
        template=go.layout.Template(),
        height=_AROUND_PX + max(2, len(names) - 1) * _PANEL_PX,
        margin={"l": 64, "r": 12, "t": 16, "b": 64},
        hovermode="closest",
        showlegend=False,
    )
    plain: dict[str, Any] = json.loads(figure.to_json())
    return plain


def _panel(
    figure: go.Figure,
    pair: CoveredPair,
    axes: tuple[str, str],
    labels: tuple[list[str], list[str]],
    most: int,
    place: tuple[int, int],
) -> None:
    """One pair: ``axes`` and ``labels`` are those of x and y."""
    cases, weights = pair.cases, pair.weights
    if pair.parameters[0] == axes[0]:  # rows of a heat map are its y
        cases = [list(row) for row in zip(*cases, strict=True)]
        weights = [list(row) for row in zip(*weights, strict=True)]
    largest = max((w for row in weights for w in row), default=1.0)
    tried = [[n or None for n in row] for row in cases]
    missing = [
        [w if not n and w > POSSIBLE_MIN else None for n, w in zip(ns, ws, strict=True)]
        for ns, ws in zip(cases, weights, strict=True)
    ]
    for z, scale, top, says in (
        (tried, _TRIED, most, "%{z} cases"),
        (missing, _UNTRIED, largest, "not tried, probability %{z:.2g}"),
    ):
        figure.add_heatmap(
            x=labels[0],
            y=labels[1],
            z=z,
            zmin=0,
            zmax=top,
            colorscale=scale,
            showscale=False,
            hoverongaps=False,
            xgap=1,
            ygap=1,
            hovertemplate=f"%{{x}}<br>%{{y}}<br>{says}<extra></extra>",
            row=place[0],
            col=place[1],
        )
