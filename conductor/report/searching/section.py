"""The section of a report about a search: its answer, its failures by cluster, two plots."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from conductor.records.search import read_search
from conductor.report.searching.boundary import boundary_figure
from conductor.report.searching.coverage_figure import coverage_figure
from conductor.report.searching.indices_figure import indices_figure, ranked
from conductor.report.searching.looks import FAILED, HELD, LIMIT
from conductor.report.searching.map_figure import map_figure
from conductor.search.answers.coverage import POSSIBLE_MIN
from schemas.files.search_result import (
    FILE_NAME,
    SearchAnswer,
    SearchCluster,
    SearchCoverage,
    SearchFile,
)
from schemas.kinds.kpi import scalars_by_name
from schemas.sections.search import Value
from schemas.words import counted

PAIRS_MAX = 50
"""Most pairs of parameters in the table of what was tried."""
CLUSTERS_MAX = 50
"""Most clusters in the table."""
_HEIGHT_PX = 520


class ShownCluster(NamedTuple):
    """Failures that lie beside each other."""

    cluster: SearchCluster
    spans: list[str]
    """What each parameter is in them: a value, or the ends of a range."""


class CoveredLine(NamedTuple):
    """Cells of a parameter, or of a pair of them."""

    names: list[str]
    possible: int
    tried: int
    untried: float
    """Probability of those that were not tried."""


@dataclass(frozen=True, slots=True)
class SearchShown:
    """A search with what a page says of it."""

    file: SearchFile
    title: str
    """What it looked for, in a sentence."""
    clusters: list[ShownCluster]
    answer: str
    """What is known, in a sentence without its stop; empty: nothing yet."""
    method: str
    """How it was obtained."""
    interval: bool
    """Whether a probability is drawn."""
    left_out: int
    """Clusters that are not shown."""
    indices: str
    """How indices were obtained, in sentences; empty: there are none."""


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
    answer = file.answer
    return SearchShown(
        file=file,
        title=title,
        clusters=_clusters(file)[:CLUSTERS_MAX],
        answer=_capital(answer.line()) if answer else "",
        method=_capital(answer.method) if answer else "",
        interval=bool(_known(file)),
        left_out=max(0, len(file.clusters) - CLUSTERS_MAX),
        indices=_indices_text(file),
    )


def covered_lines(coverage: SearchCoverage | None) -> list[CoveredLine]:
    """How much of a domain was tried: a line for each parameter, then for pairs."""
    if coverage is None:
        return []
    lines = []
    for part in coverage.parameters:
        cells = [(w, n) for w, n in zip(part.weights, part.cases, strict=True) if w > POSSIBLE_MIN]
        tried = sum(n > 0 for _, n in cells)
        left = sum(w for w, n in cells if not n)
        lines.append(CoveredLine([part.parameter], len(cells), tried, left))
    for pair in coverage.pairs[:PAIRS_MAX]:
        lines.append(CoveredLine(pair.parameters, pair.possible, pair.tried, pair.untried))
    return lines


def mildest(file: SearchFile | None) -> list[str]:
    """The mildest case of each cluster, of the largest cluster first."""
    return [] if file is None else [cluster.mildest for cluster in file.clusters]


def values_of(file: SearchFile, case: str) -> list[Value] | None:
    """Values of the parameters of a case; None: the search proposed none of that name."""
    for generation in file.generations:
        if case in generation.cases:
            return generation.values[generation.cases.index(case)]
    return None


def _clusters(file: SearchFile) -> list[ShownCluster]:
    values = {
        name: row
        for generation in file.generations
        for name, row in zip(generation.cases, generation.values, strict=True)
    }
    return [
        ShownCluster(cluster, [_span(list(column)) for column in columns])
        for cluster in file.clusters
        for columns in [zip(*(values[name] for name in cluster.cases), strict=True)]
    ]


def _span(values: list[Value]) -> str:
    """The value, or the ends of the range; of words, which there are."""
    if any(isinstance(value, bool | str) for value in values):
        return ", ".join(dict.fromkeys(map(str, values)))
    numbers = [float(value) for value in values]
    low, high = f"{min(numbers):.6g}", f"{max(numbers):.6g}"
    return low if low == high else f"{low} to {high}"


def _indices_text(file: SearchFile) -> str:
    if file.indices is None:
        return ""
    told = (
        "The share of the variance that is due to each parameter, with 95 % intervals. "
        f"{_capital(file.indices.method)}; {counted(file.indices.cases, 'case')}."
    )
    if not file.indices.failure and (file.fails_below is not None or file.fails_above is not None):
        told += " For failures there are none: fewer than ten cases failed, or held."
    return told


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def search_figures(
    file: SearchFile | None, coverage: SearchCoverage | None
) -> dict[str, dict[str, Any] | None]:
    """The figures of a search by the names of their places on the page; None: nothing to draw. Of a
    campaign without one, that of what it tried."""
    indices = None if file is None else file.indices
    covered = {"covered": coverage_figure(coverage, ranked(indices))}
    if file is None:
        return covered
    return {
        **covered,
        "searched": search_figure(file),
        "boundary": boundary_figure(file),
        "indexed": indices_figure(file.indices, file.kpi),
        "mapped": map_figure(file),
    }


def search_figure(file: SearchFile | None) -> dict[str, Any] | None:
    """KPI of every case in the order of proposals, and the probability with its interval after each
    generation; None: there is nothing to draw."""
    if file is None or not any(generation.results for generation in file.generations):
        return None
    known = _known(file)
    figure = make_subplots(rows=2 if known else 1, cols=1, vertical_spacing=0.16)
    _cases(figure, file)
    kind = scalars_by_name().get(file.kpi)
    unit = f" [{kind.unit}]" if kind is not None and kind.unit else ""
    figure.update_xaxes(title={"text": "Case, in the order of proposals"}, row=1, col=1)
    figure.update_yaxes(title={"text": f"{file.kpi}{unit}"}, row=1, col=1)
    if known:
        _answers(figure, known)
        figure.update_xaxes(title={"text": "Cases of closed generations"}, row=2, col=1)
        figure.update_yaxes(title={"text": "Probability of failure"}, row=2, col=1)
    figure.update_layout(
        template=go.layout.Template(),
        height=_HEIGHT_PX if known else _HEIGHT_PX * 0.6,
        margin={"l": 64, "r": 12, "t": 16, "b": 48},
        hovermode="closest",
        showlegend=False,
    )
    plain: dict[str, Any] = json.loads(figure.to_json())
    return plain


def _cases(figure: go.Figure, file: SearchFile) -> None:
    names = [name for name, _, _ in file.closed()]
    kpis = [kpi for _, _, kpi in file.closed()]
    limit = file.fails_below if file.fails_below is not None else file.fails_above
    places = [index for index, value in enumerate(kpis) if value is not None]
    figure.add_scatter(
        x=places,
        y=[kpis[index] for index in places],
        text=[f"<b>{names[index]}</b>" for index in places],
        hovertemplate="%{text}<br>%{y:.4g}<extra></extra>",
        mode="markers",
        marker={"size": 5, "color": [FAILED if file.fails(kpis[i]) else HELD for i in places]},
        row=1,
        col=1,
    )
    if limit is not None:
        figure.add_scatter(
            x=[0, max(1, len(kpis) - 1)],
            y=[limit, limit],
            mode="lines",
            line={"color": LIMIT, "dash": "dash", "width": 1.5},
            hoverinfo="skip",
            row=1,
            col=1,
        )


def _known(file: SearchFile) -> list[SearchAnswer]:
    """Answers with a probability; an extreme and a boundary have none."""
    answers = [generation.answer for generation in file.generations]
    return [answer for answer in answers if answer and answer.probability is not None]


def _answers(figure: go.Figure, known: list[SearchAnswer]) -> None:
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
        marker={"size": 6, "color": HELD},
        row=2,
        col=1,
    )
