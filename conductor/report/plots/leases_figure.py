"""The figure of leases over wall time: a line per slot of each worker, and the throughput."""

from __future__ import annotations

import heapq
import html
import json
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from conductor.records.timeline import COMMITTED
from conductor.report.pages.tables import statuses
from conductor.report.plots.palette import status_color
from conductor.report.reading.dossier import Dossier
from conductor.report.reading.leases import STILL_OPEN, Leases, LeaseSpan

SPANS_MAX = 6000
"""Most leases that are drawn, the first ones."""
BINS_MAX = 60
"""Most bars of the throughput."""
_LANE_PX = (4, 18)
"""Least and most height of a lane."""
_HEIGHT_PX = 620
"""Wanted height of all lanes together, at most."""
_OTHER_COLORS = {"superseded": "#A9AEB5", STILL_OPEN: "#56B4E9"}
_GIVEN_BACK = "#111111"
_MINUTES_FROM_S = 300


def lanes_of(spans: list[LeaseSpan]) -> tuple[list[tuple[str, int]], list[int]]:
    """(worker, slot) of every lane, by worker; and the lane of each span.

    A worker has as many lanes as leases at once; a lease takes the first that is free.
    """
    free: dict[str, list[int]] = {}
    held: dict[str, list[tuple[float, int]]] = {}
    count: dict[str, int] = {}
    slots = []
    for span in spans:
        leases = held.setdefault(span.worker, [])
        empty = free.setdefault(span.worker, [])
        while leases and leases[0][0] <= span.start_s:
            heapq.heappush(empty, heapq.heappop(leases)[1])
        if empty:
            slot = heapq.heappop(empty)
        else:
            slot = count.get(span.worker, 0)
            count[span.worker] = slot + 1
        heapq.heappush(leases, (span.end_s, slot))
        slots.append(slot)
    lanes = [(worker, slot) for worker, total in count.items() for slot in range(total)]
    index = {lane: number for number, lane in enumerate(lanes)}
    return lanes, [index[span.worker, slot] for span, slot in zip(spans, slots, strict=True)]


def leases_figure(dossier: Dossier, leases: Leases) -> dict[str, Any] | None:
    """Plotly JSON with ``data`` and ``layout``; None without leases."""
    spans = leases.spans[:SPANS_MAX]
    if not spans:
        return None
    lanes, places = lanes_of(spans)
    last_s = max(span.end_s for span in leases.spans)
    per_unit_s, unit = (60.0, "min") if last_s > _MINUTES_FROM_S else (1.0, "s")
    lane_px = min(max(_HEIGHT_PX / len(lanes), _LANE_PX[0]), _LANE_PX[1])
    lanes_px, bars_px = round(lane_px * len(lanes)) + 10, 130
    figure = make_subplots(
        rows=2,
        cols=1,
        shared_xaxes=True,
        vertical_spacing=40 / (lanes_px + bars_px + 40),
        row_heights=[lanes_px, bars_px],
        subplot_titles=["Leases by worker", "Results"],
    )
    for note in figure.layout.annotations:
        note.update(x=0, xanchor="left", font={"size": 13, "weight": 600})
    for trace in _lease_traces(dossier, spans, places, per_unit_s, unit, lane_px):
        figure.add_trace(trace, row=1, col=1)
    figure.add_trace(_throughput(leases, last_s, per_unit_s, unit), row=2, col=1)
    firsts = [number for number, (_, slot) in enumerate(lanes) if slot == 0]
    step = max(1, round(14 * len(firsts) / lanes_px))
    figure.update_yaxes(
        tickvals=firsts[::step],
        ticktext=[html.escape(lanes[number][0], quote=False) for number in firsts[::step]],
        range=[len(lanes) - 0.4, -0.6],
        showgrid=False,
        zeroline=False,
        row=1,
        col=1,
    )
    figure.update_yaxes(title={"text": f"[1/{unit}]"}, rangemode="tozero", row=2, col=1)
    figure.update_xaxes(title={"text": f"Wall time [{unit}]"}, row=2, col=1)
    figure.update_layout(
        template=go.layout.Template(),
        height=lanes_px + bars_px + 150,
        margin={"l": 130, "r": 12, "t": 70, "b": 48},
        hovermode="closest",
        bargap=0.05,
        legend={"orientation": "h", "yref": "container", "y": 0.99, "yanchor": "top", "x": 0},
    )
    plain: dict[str, Any] = json.loads(figure.to_json())
    return plain


def _lease_traces(
    dossier: Dossier,
    spans: list[LeaseSpan],
    places: list[int],
    per_unit_s: float,
    unit: str,
    lane_px: float,
) -> list[Any]:
    """One trace per kind of end; a gap lies between two leases of it."""
    status = {row.case.id: row.status for row in dossier.rows}
    kinds: dict[str, list[tuple[LeaseSpan, int]]] = {}
    for span, place in zip(spans, places, strict=True):
        kind = status.get(span.case, COMMITTED) if span.how == COMMITTED else span.how
        kinds.setdefault(kind, []).append((span, place))
    order = statuses(dossier)
    kinds = {kind: kinds[kind] for kind in (*order, *kinds) if kind in kinds}
    traces = []
    for kind, placed in kinds.items():
        x: list[float | None] = []
        y: list[int | None] = []
        text: list[str] = []
        for span, place in placed:
            start, end = span.start_s / per_unit_s, span.end_s / per_unit_s
            # A small gap keeps neighbours apart, and the middle can be hovered over.
            x += [start, (start + end) / 2, max(start, end - 0.002 * (end - start)), None]
            y += [place, place, place, None]
            label = (
                f"<b>{html.escape(span.case, quote=False)}</b><br>attempt {span.attempt}, "
                f"{span.end_s - span.start_s:.1f} s, {kind.replace('_', ' ')}"
            )
            text += [label, label, label, ""]
        results = all(span.how == COMMITTED for span, _ in placed)
        color = status_color(kind) if results else _OTHER_COLORS.get(kind, _GIVEN_BACK)
        traces.append(
            go.Scatter(
                x=x,
                y=y,
                text=text,
                mode="lines",
                connectgaps=False,
                name=f"{kind.replace('_', ' ')} ({len(placed)})",
                line={"color": color, "width": max(2.0, 0.7 * lane_px)},
                hovertemplate=f"%{{text}}<br>%{{x:.1f}} {unit}<extra></extra>",
            )
        )
    return traces


def _throughput(leases: Leases, last_s: float, per_unit_s: float, unit: str) -> Any:
    """Results per unit of time, in even bins."""
    bins = max(1, min(BINS_MAX, len(leases.commits_s)))
    width_s = max(last_s / bins, 1e-9)
    counts = [0] * bins
    for at_s in leases.commits_s:
        counts[min(bins - 1, int(at_s / width_s))] += 1
    width = width_s / per_unit_s
    return go.Bar(
        x=[(number + 0.5) * width for number in range(bins)],
        y=[count / width for count in counts],
        width=width * 0.95,
        customdata=counts,
        marker={"color": "#8C8C8C"},
        showlegend=False,
        hovertemplate=f"%{{customdata}} results, %{{y:.2f}} per {unit}<extra></extra>",
    )
