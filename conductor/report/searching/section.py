"""The section of a report about a search: its answer, its failures by cluster, two plots."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from conductor.records.search import read_search
from schemas.files.search_result import FILE_NAME, SearchCluster, SearchFile
from schemas.kinds.kpi import scalars_by_name

CLUSTERS_MAX = 50
"""Most clusters in the table."""
_FAILED, _HELD, _LIMIT = "#c0392b", "#3a6ea5", "#888888"
_HEIGHT_PX = 520


@dataclass(frozen=True, slots=True)
class SearchShown:
    """A search with what a page says of it."""

    file: SearchFile
    title: str
    """What it looked for, in a sentence."""
    clusters: list[SearchCluster]
    answer: str
    """What is known, in a sentence without its stop; empty: nothing yet."""
    method: str
    """How it was obtained."""
    left_out: int
    """Clusters that are not shown."""


def read_shown_search(folder: Path) -> SearchFile | None:
    """The search of a campaign folder; None: it is none, or nothing has closed yet.

    Raises:
        InfrastructureError: its file is damaged.
    """
    return read_search(folder) if (folder / FILE_NAME).exists() else None


def search_shown(file: SearchFile | None) -> SearchShown | None:
    """What is shown of a search; None: there is none."""
    if file is None:
        return None
    kind = scalars_by_name().get(file.kpi)
    unit = f" {kind.unit}" if kind is not None and kind.unit else ""
    if file.formula:
        title = f"A case fails if it breaks: {file.formula}."
    elif file.fails_below is not None:
        title = f"A case fails if {file.kpi} is below {file.fails_below:g}{unit}."
    elif file.fails_above is not None:
        title = f"A case fails if {file.kpi} is above {file.fails_above:g}{unit}."
    else:
        title = f"The search looked for an extreme of {file.kpi}."
    shown = file.clusters[:CLUSTERS_MAX]
    answer = file.answer
    return SearchShown(
        file=file,
        title=title,
        clusters=shown,
        answer=_capital(answer.line()) if answer else "",
        method=_capital(answer.method) if answer else "",
        left_out=len(file.clusters) - len(shown),
    )


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def search_figure(file: SearchFile | None) -> dict[str, Any] | None:
    """KPI of every case in the order of proposals, and the probability with its interval after each
    generation; None: there is nothing to draw."""
    if file is None or not any(generation.results for generation in file.generations):
        return None
    figure = make_subplots(rows=2, cols=1, vertical_spacing=0.16)
    _cases(figure, file)
    _answers(figure, file)
    kind = scalars_by_name().get(file.kpi)
    unit = f" [{kind.unit}]" if kind is not None and kind.unit else ""
    figure.update_xaxes(title={"text": "Case, in the order of proposals"}, row=1, col=1)
    figure.update_yaxes(title={"text": f"{file.kpi}{unit}"}, row=1, col=1)
    figure.update_xaxes(title={"text": "Cases of closed generations"}, row=2, col=1)
    figure.update_yaxes(title={"text": "Probability of failure"}, row=2, col=1)
    figure.update_layout(
        template=go.layout.Template(),
        height=_HEIGHT_PX,
        margin={"l": 64, "r": 12, "t": 16, "b": 48},
        hovermode="closest",
        showlegend=False,
    )
    plain: dict[str, Any] = json.loads(figure.to_json())
    return plain


def _cases(figure: go.Figure, file: SearchFile) -> None:
    names, kpis = [], []
    for generation in file.generations:
        for name, value in zip(generation.cases, generation.results, strict=False):
            names.append(name)
            kpis.append(value)
    limit = file.fails_below if file.fails_below is not None else file.fails_above
    places = [index for index, value in enumerate(kpis) if value is not None]
    figure.add_scatter(
        x=places,
        y=[kpis[index] for index in places],
        text=[f"<b>{names[index]}</b>" for index in places],
        hovertemplate="%{text}<br>%{y:.4g}<extra></extra>",
        mode="markers",
        marker={"size": 5, "color": [_FAILED if file.fails(kpis[i]) else _HELD for i in places]},
        row=1,
        col=1,
    )
    if limit is not None:
        figure.add_scatter(
            x=[0, max(1, len(kpis) - 1)],
            y=[limit, limit],
            mode="lines",
            line={"color": _LIMIT, "dash": "dash", "width": 1.5},
            hoverinfo="skip",
            row=1,
            col=1,
        )


def _answers(figure: go.Figure, file: SearchFile) -> None:
    answers = [generation.answer for generation in file.generations]
    known = [answer for answer in answers if answer and answer.probability is not None]
    middle = [answer.probability or 0.0 for answer in known]
    figure.add_scatter(
        x=[answer.cases for answer in known],
        y=middle,
        error_y={
            "type": "data",
            "symmetric": False,
            "array": [
                (a.high if a.high is not None else p) - p
                for a, p in zip(known, middle, strict=True)
            ],
            "arrayminus": [
                p - (a.low if a.low is not None else p) for a, p in zip(known, middle, strict=True)
            ],
        },
        hovertemplate="%{x} cases: %{y:.3g}<extra></extra>",
        mode="markers",
        marker={"size": 6, "color": _HELD},
        row=2,
        col=1,
    )
