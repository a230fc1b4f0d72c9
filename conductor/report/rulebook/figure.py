"""The figure of residual speeds: how fast the ego still was at an impact, over its speed before."""

from __future__ import annotations

import html
import json
import math
from collections.abc import Sequence
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from conductor.report.plots.palette import line_styles, status_color
from schemas.files.rulebook_result import (
    RulebookPoint,
    RulebookResult,
    RulebookRowResult,
    RulebookRun,
)

COLUMNS = 3
"""Panels beside each other; on narrow screens one."""
_PANEL_PX, _GAP_PX, _TOP_PX, _BOTTOM_PX = 180, 62, 64, 56
_LIMIT_COLOR = "#8C8C8C"
_MARKERS = {"avoided": "circle", "pass": "circle", "inconclusive": "x-thin"}


def residual_figure(result: RulebookResult, columns: int = COLUMNS) -> dict[str, Any] | None:
    """A panel per group, with a point per run with a known speed at the begin of its test, a line
    per test through the fastest impacts; dashed: the largest that passes. None: nothing is known of
    any run.

    Args:
        result: of the rulebook.
        columns: panels beside each other, at most.
    """
    groups = [(group.title, _known(result, group.group)) for group in result.groups]
    panels = [(title, rows) for title, rows in groups if rows]
    if not panels:
        return None
    columns = min(columns, len(panels))
    lines = math.ceil(len(panels) / columns)
    height_px = lines * _PANEL_PX + (lines - 1) * _GAP_PX
    figure = make_subplots(
        rows=lines,
        cols=columns,
        horizontal_spacing=0.05,
        vertical_spacing=_GAP_PX / height_px if lines > 1 else 0,
        subplot_titles=[html.escape(title, quote=False) for title, _ in panels],
    )
    for note in figure.layout.annotations:
        note.update(font={"size": 13, "weight": 600})
    for index, (_, rows) in enumerate(panels):
        row, column = index // columns + 1, index % columns + 1
        _draw(figure, rows, row, column)
        figure.update_yaxes(rangemode="tozero", row=row, col=column)
        if column == 1:
            figure.update_yaxes(title={"text": "At the impact [km/h]"}, row=row, col=column)
        if index + columns >= len(panels):
            figure.update_xaxes(title={"text": "Ego before [km/h]"}, row=row, col=column)
    figure.update_layout(
        template=go.layout.Template(),
        height=_TOP_PX + height_px + _BOTTOM_PX,
        margin={"l": 64, "r": 12, "t": _TOP_PX, "b": _BOTTOM_PX},
        hovermode="closest",
        showlegend=False,
    )
    plain: dict[str, Any] = json.loads(figure.to_json())
    return plain


def _known(result: RulebookResult, group: str) -> list[RulebookRowResult]:
    """Rows of a group with a run whose speed at the begin is known."""
    return [row for row in result.rows if row.group == group and _runs(row.points)]


def _runs(points: Sequence[RulebookPoint]) -> list[RulebookRun]:
    return [run for point in points for run in point.runs if run.begin_kmh is not None]


def _draw(figure: go.Figure, rows: Sequence[RulebookRowResult], row: int, column: int) -> None:
    """The tests of a group in one panel: limits, lines, points."""
    tests = list(dict.fromkeys(result.test for result in rows))
    styles = line_styles("test", tests)
    drawn: set[tuple[tuple[float, float], ...]] = set()
    for test in tests:
        points = [point for result in rows if result.test == test for point in result.points]
        limits = _limits(points)
        if limits and limits not in drawn:  # often all tests of a group have the same
            drawn.add(limits)
            figure.add_scatter(
                x=[at for at, _ in limits],
                y=[limit for _, limit in limits],
                mode="lines",
                line={"color": _LIMIT_COLOR, "dash": "dash", "shape": "vh", "width": 1.5},
                hoverinfo="skip",
                row=row,
                col=column,
            )
        runs = sorted(_runs(points), key=lambda run: run.begin_kmh or 0.0)
        color, dash = styles[test]
        figure.add_scatter(
            **_fastest(points),
            mode="lines",
            line={"color": color, "dash": dash, "width": 1},
            hoverinfo="skip",
            row=row,
            col=column,
        )
        figure.add_scatter(
            x=[round(run.begin_kmh or 0.0, 2) for run in runs],
            y=[_residual(run) for run in runs],
            text=[
                f"<b>{run.case}</b><br>{html.escape(test, quote=False)}: "
                f"{run.status.replace('_', ' ')}"
                for run in runs
            ],
            hovertemplate="%{text}<br>%{x:.1f} km/h, at the impact %{y:.1f} km/h<extra></extra>",
            name=test,
            mode="markers",
            marker={
                "color": [status_color(run.status) for run in runs],
                "size": 8,
                "symbol": [_MARKERS.get(run.status, "diamond") for run in runs],
                "line": {"color": [status_color(run.status) for run in runs], "width": 1},
            },
            row=row,
            col=column,
        )


def _limits(points: Sequence[RulebookPoint]) -> tuple[tuple[float, float], ...]:
    """Largest relative impact speeds that pass, over the speed before [km/h]."""
    limits = {
        (float(round(point.runs[0].begin_kmh)), point.limit_kmh)
        for point in points
        if point.limit_kmh is not None and point.runs[0].begin_kmh is not None
    }
    return tuple(sorted(limits))


def _fastest(points: Sequence[RulebookPoint]) -> dict[str, list[float]]:
    """The fastest impact of each point, over the speed before [km/h]."""
    tops = [
        max(known, key=lambda run: (_residual(run), run.begin_kmh or 0.0))
        for point in points
        if (known := _runs([point]))
    ]
    tops.sort(key=lambda run: run.begin_kmh or 0.0)
    return {
        "x": [round(run.begin_kmh or 0.0, 2) for run in tops],
        "y": [_residual(run) for run in tops],
    }


def _residual(run: RulebookRun) -> float:
    """Relative impact speed; 0 without a contact."""
    return 0.0 if run.impact_kmh is None else round(run.impact_kmh, 2)
