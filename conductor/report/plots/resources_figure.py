"""The figure of the resource section: use over wall-clock time, one colour per node."""

from __future__ import annotations

import html
import json
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from conductor.report.plots.palette import line_styles
from conductor.report.reading.resources_use import QUANTITIES, Floats, Resources, UseSeries
from schemas.files.resources import PERIOD_S

POINTS_MAX = 500
"""Most points of one line; of each group of neighbours the largest is drawn."""
NODES_MAX = 8
"""Most nodes with a line of their own; beyond, the busiest are drawn."""
GAP_PERIODS = 4
"""A line is interrupted where no sample came for so long [periods]."""

_ROWS = (
    ("cpu_cores", "CPU", "cores"),
    ("ram_gb", "RAM", "GB"),
    ("gpu_percent", "GPU", "%"),
    ("gpu_memory_gb", "GPU memory", "GB"),
    ("gpu_power_w", "GPU power", "W"),
)
assert {name for name, _, _ in _ROWS} <= set(QUANTITIES)
_ROW_PX = 140
_MINUTES_FROM_S = 300


def resource_figure(resources: Resources) -> dict[str, Any] | None:
    """Plotly JSON with ``data`` and ``layout``; None without samples.

    Rows are CPU and RAM of the workers, and of their GPUs what was measured at all.
    """
    if resources.total is None:
        return None
    spans = resources.total.spans
    rows = [row for row in _ROWS if spans[row[0]] is not None]
    figure = make_subplots(
        rows=len(rows),
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.2 / len(rows),
        subplot_titles=[title for _, title, _ in rows],
    )
    for note in figure.layout.annotations:
        note.update(x=0, xanchor="left", font={"size": 13, "weight": 600})
    nodes = _busiest(resources)
    start = min(int(resources.series[node].moment[0]) for node in nodes)
    end = max(int(resources.series[node].moment[-1]) for node in nodes)
    per_unit_s, time_unit = (60, "min") if (end - start) * PERIOD_S > _MINUTES_FROM_S else (1, "s")
    styles = line_styles("node", nodes)
    for index, (name, _, unit) in enumerate(rows, 1):
        for node in nodes:
            moments, y = thinned(resources.series[node], name)
            x = [None if m is None else (m - start) * PERIOD_S / per_unit_s for m in moments]
            color, dash = styles[node]
            label = html.escape(node, quote=False)
            figure.add_trace(
                go.Scatter(
                    x=x,
                    y=y,
                    mode="lines+markers" if len(x) < 30 else "lines",
                    name=label,
                    legendgroup=node,
                    showlegend=index == 1,
                    connectgaps=False,
                    line={"color": color, "dash": dash, "width": 1.6},
                    hovertemplate=f"{label}<br>%{{x:.1f}} {time_unit}: %{{y:.2f}} {unit}"
                    "<extra></extra>",
                ),
                row=index,
                col=1,
            )
        figure.update_yaxes(title={"text": f"[{unit}]"}, rangemode="tozero", row=index, col=1)
    figure.update_xaxes(title={"text": f"Wall time [{time_unit}]"}, row=len(rows), col=1)
    figure.update_layout(
        template=go.layout.Template(),
        height=110 + _ROW_PX * len(rows),
        margin={"l": 72, "r": 12, "t": 60, "b": 48},
        hovermode="closest",
        showlegend=len(nodes) > 1,
        legend={"orientation": "h", "yref": "container", "y": 0.99, "yanchor": "top", "x": 0},
    )
    plain: dict[str, Any] = json.loads(figure.to_json())
    return plain


def thinned(series: UseSeries, name: str) -> tuple[list[int | None], list[float | None]]:
    """Moments and values; None where the line is interrupted."""
    moment = series.moment
    values: Floats = series.values[name]
    group = -(-len(moment) // POINTS_MAX)
    x: list[int | None] = []
    y: list[float | None] = []
    last = int(moment[0])
    for first in range(0, len(moment), group):
        chunk = values[first : first + group]
        known = chunk[~np.isnan(chunk)]
        now = int(moment[first])
        if now - last > GAP_PERIODS * group:
            x.append(None)
            y.append(None)
        last = int(moment[min(first + group, len(moment)) - 1])
        x.append(now)
        y.append(float(known.max()) if len(known) else None)
    return x, y


def _busiest(resources: Resources) -> list[str]:
    def peak(node: str) -> float:
        span = resources.series[node].span("cpu_cores")
        return span.most if span else 0.0

    nodes = sorted(resources.series, key=peak, reverse=True)[:NODES_MAX]
    return sorted(nodes)
