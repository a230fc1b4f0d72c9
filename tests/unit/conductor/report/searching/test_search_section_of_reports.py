"""What a report shows of a search."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from search_bench import KPI, searched, section, trace

from conductor.report.pages.templates import environment
from conductor.report.searching.boundary import boundary_figure
from conductor.report.searching.section import (
    covered_lines,
    mildest,
    read_shown_search,
    search_figure,
    search_figures,
    search_shown,
)
from schemas.files.search_result import FILE_NAME, SearchFile
from twin.base.errors import InfrastructureError


@pytest.fixture(scope="module")
def found() -> SearchFile:
    search = section(objective={"kpi": KPI, "fails_below": 0.8}, budget={"cases": 30})
    return msgspec.json.decode(trace(searched(search).state), type=SearchFile)


def _around(found: SearchFile) -> dict[str, Any]:
    """What a page has beside the search."""
    return {
        "failures": [],
        "drawn": {"searched", "covered"},
        "run_name": "kerb",
        "found_there": ", where its stack is",
        "keep": ["first command", "second command"],
        "declared": True,
        "content": SimpleNamespace(coverage=found.coverage),
        "covered": covered_lines(found.coverage),
    }


def test_a_folder_without_a_search_shows_none(tmp_path: Path) -> None:
    assert read_shown_search(tmp_path) is None
    assert search_shown(None) is None
    assert search_figure(None) is None


def test_a_damaged_file_is_told(tmp_path: Path) -> None:
    (tmp_path / FILE_NAME).write_text("{")
    with pytest.raises(InfrastructureError, match=r"search\.json: damaged"):
        read_shown_search(tmp_path)


def test_the_page_tells_answer_and_clusters(found: SearchFile) -> None:
    shown = search_shown(found)
    assert shown is not None
    assert shown.title == f"A case fails if {KPI} is below 0.8 m."
    assert shown.answer.startswith("Probability of failure 0.")
    assert found.answer is not None
    assert sum(len(row.cluster.cases) for row in shown.clusters) == found.answer.failures
    template = environment(autoescape=True).from_string(
        "{% macro count(n, one, many) %}{{ n }} {{ one if n == 1 else many }}{% endmacro %}"
        "{% macro film(case) %}film of {{ case }}{% endmacro %}"
        '{% include "search.html.j2" with context %}'
    )
    page = template.render(found=shown, **_around(found))
    assert "with the 30 cases in them" in page
    assert '<div id="covered">' in page
    assert "3 generations so far" in page
    assert "It ended: the budget of 30 cases is spent." in page
    first = shown.clusters[0]
    assert f"<code>{first.cluster.mildest}</code> film of {first.cluster.mildest}" in page
    assert mildest(found)[0] == first.cluster.mildest
    assert "In the folder that holds <code>kerb</code>, where its stack is, the first" in page
    assert "<pre><code>first command\nsecond command</code></pre>" in page
    assert "Cells of the declared operational domain (<code>search.domain</code>)" in page
    undeclared = template.render(found=shown, **{**_around(found), "declared": False})
    assert "operational domain" not in undeclared
    assert "Cells of the parameters" in undeclared
    assert len(first.cluster.cases) > 1
    assert f'<small class="dim">{first.spans[0]}</small>' in page
    values = {
        name: row for g in found.generations for name, row in zip(g.cases, g.values, strict=True)
    }
    inside = [float(values[name][0]) for name in first.cluster.cases]
    low, high = first.spans[0].split(" to ")
    assert (float(low), float(high)) == (
        pytest.approx(min(inside), rel=1e-5),
        pytest.approx(max(inside), rel=1e-5),
    )


def test_the_figure_has_every_case_and_every_answer(found: SearchFile) -> None:
    figure = search_figure(found)
    assert figure is not None
    cases, limit, answers = figure["data"]
    assert len(cases["text"]) == 30
    assert cases["text"][0] == "<b>g0000-0000</b>"
    assert limit["mode"] == "lines"
    assert len(answers["hovertemplate"]) > 0
    assert len(found.generations) == 3


def test_bars_of_a_design_have_intervals_and_a_panel_for_failures() -> None:
    search = section(
        "sensitivity",
        objective={"kpi": KPI, "fails_below": 0.8},
        budget={"cases": 256, "generation": 128},
    )
    found = msgspec.json.decode(trace(searched(search).state), type=SearchFile)
    figure = search_figures(found, found.coverage)["indexed"]
    assert figure is not None
    assert [trace["name"] for trace in figure["data"]] == 2 * [
        "First order: alone",
        "Total order: with others",
    ]
    assert len(figure["data"][0]["error_x"]["array"]) == 2
    shown = search_shown(found)
    assert shown is not None
    assert "Sobol indices of Saltelli's design with 64 rows" in shown.indices
    assert shown.indices.endswith("; 256 cases.")


def test_maps_show_what_was_tried_and_what_was_not(found: SearchFile) -> None:
    figure = search_figures(found, found.coverage)["covered"]
    assert figure is not None
    tried, missing = (trace["z"] for trace in figure["data"])
    assert sum(n or 0 for row in tried for n in row) == 30
    for row, other in zip(tried, missing, strict=True):
        assert not any(n and w for n, w in zip(row, other, strict=True))
    shown = search_shown(found)
    assert shown is not None
    lines = covered_lines(found.coverage)
    assert [len(line.names) for line in lines] == [1, 1, 2]
    assert lines[2].possible == 64


def test_the_map_has_every_case_above_the_shares() -> None:
    search = section(objective={"kpi": KPI, "fails_below": 0.8}, budget={"cases": 120})
    found = msgspec.json.decode(trace(searched(search).state), type=SearchFile)
    assert found.failure_map is not None
    figure = search_figures(found, found.coverage)["mapped"]
    assert figure is not None
    shares, held, failed = figure["data"]
    assert shares["type"] == "contour"
    assert len(held["text"]) + len(failed["text"]) == 120
    assert found.answer is not None
    assert len(failed["text"]) == found.answer.failures
    assert found.failure_map.parameters[0] in found.parameters


def test_a_boundary_is_drawn_with_its_brackets(found: SearchFile) -> None:
    assert boundary_figure(None) is None
    assert boundary_figure(found) is None
    search = section("boundary", budget={"cases": 200, "generation": 30}, options={"grid": 4})
    traced = msgspec.json.decode(trace(searched(search).state), type=SearchFile)
    figure = boundary_figure(traced)
    assert figure is not None
    assert traced.boundary is not None
    cases, line, brackets = figure["data"]
    assert len(cases["x"]) == traced.answer.cases
    assert len(line["x"]) == sum(len(part) + 1 for part in traced.boundary.lines)
    assert len(brackets["x"]) == 3 * len(traced.boundary.points)
    template = environment(autoescape=True).from_string(
        "{% macro count(n, one, many) %}{{ n }} {{ one if n == 1 else many }}{% endmacro %}"
        "{% macro film(case) %}film of {{ case }}{% endmacro %}"
        '{% include "search.html.j2" with context %}'
    )
    page = template.render(found=search_shown(traced), **_around(traced))
    assert '<div id="boundary"></div>' in page
    assert "Boundary in objects.a.start_s and objects.a.offset_m; " in page


def test_a_formula_is_told(found: SearchFile) -> None:
    formula = "always (ttc_s > 1.0)"
    shown = search_shown(msgspec.structs.replace(found, formula=formula, kpi="robustness"))
    assert shown is not None
    assert shown.title == f"A case fails if it breaks: {formula}."


def test_an_extreme_has_no_plot_of_a_probability() -> None:
    search = section(
        "cma_es", objective={"kpi": KPI, "goal": "least"}, budget={"cases": 12, "generation": 6}
    )
    found = msgspec.json.decode(trace(searched(search).state), type=SearchFile)
    figure = search_figure(found)
    assert figure is not None
    assert len(figure["data"]) == 1
    assert "yaxis2" not in figure["layout"]
    shown = search_shown(found)
    assert shown is not None
    assert not shown.interval
