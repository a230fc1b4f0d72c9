"""The figure of residual speeds: how fast the ego still was at an impact, over its speed before."""

from __future__ import annotations

import json
from typing import Any

import plotly.graph_objects as go

from conductor.report.plots.palette import line_styles, status_color
from schemas.files.rulebook_result import RulebookResult, RulebookRun

_MARKERS = {"avoided": "circle", "pass": "circle", "inconclusive": "x-thin"}


def residual_figure(result: RulebookResult) -> dict[str, Any] | None:
    """A point per run with a known speed at the begin of its test, a line per test through the
    highest; dashed: the largest that passes. None: nothing is known of any run."""
    tests = list(dict.fromkeys(row.test for row in result.rows))
    styles = line_styles("test", tests)
    figure = go.Figure()
    for test in tests:
        points = [point for row in result.rows if row.test == test for point in row.points]
        runs = [run for point in points for run in point.runs if run.begin_kmh is not None]
        if not runs:
            continue
        color = styles[test][0]
        figure.add_scatter(
            x=[round(run.begin_kmh or 0.0, 2) for run in runs],
            y=[_residual(run) for run in runs],
            text=[f"<b>{run.case}</b><br>{run.status.replace('_', ' ')}" for run in runs],
            hovertemplate="%{text}<br>%{x:.1f} km/h, at the impact %{y:.1f} km/h<extra></extra>",
            name=test,
            mode="markers",
            legendgroup=test,
            marker={
                "color": color,
                "size": 9,
                "symbol": [_MARKERS.get(run.status, "diamond") for run in runs],
                "line": {"color": [status_color(run.status) for run in runs], "width": 2},
            },
        )
        limits = sorted(
            {
                (round(point.runs[0].begin_kmh or 0.0), point.limit_kmh)
                for point in points
                if point.limit_kmh is not None and point.runs[0].begin_kmh is not None
            }
        )
        if limits:
            figure.add_scatter(
                x=[limit[0] for limit in limits],
                y=[limit[1] for limit in limits],
                mode="lines",
                line={"color": color, "dash": "dash", "shape": "vh"},
                hoverinfo="skip",
                legendgroup=test,
                showlegend=False,
            )
    if not figure.data:
        return None
    figure.update_xaxes(title={"text": "Speed of the ego when the test begins [km/h]"})
    figure.update_yaxes(title={"text": "Relative speed at the impact [km/h]"}, rangemode="tozero")
    figure.update_layout(
        template=go.layout.Template(),
        height=420,
        margin={"l": 64, "r": 12, "t": 40, "b": 52},
        hovermode="closest",
    )
    plain: dict[str, Any] = json.loads(figure.to_json())
    return plain


def _residual(run: RulebookRun) -> float:
    """Relative impact speed; 0 without a contact."""
    return 0.0 if run.impact_kmh is None else round(run.impact_kmh, 2)
