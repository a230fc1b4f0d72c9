"""What a report shows of a search."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from search_bench import KPI, searched, section, trace

from conductor.report.pages.templates import environment
from conductor.report.searching.boundary import boundary_figure
from conductor.report.searching.section import read_shown_search, search_figure, search_shown
from schemas.files.search_result import FILE_NAME, SearchFile
from twin.base.errors import InfrastructureError


@pytest.fixture(scope="module")
def found() -> SearchFile:
    search = section(objective={"kpi": KPI, "fails_below": 0.8}, budget={"cases": 30})
    return msgspec.json.decode(trace(searched(search).state), type=SearchFile)


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
    assert sum(len(cluster.cases) for cluster in shown.clusters) == found.answer.failures
    template = environment(autoescape=True).from_string(
        "{% macro count(n, one, many) %}{{ n }} {{ one if n == 1 else many }}{% endmacro %}"
        '{% include "search.html.j2" with context %}'
    )
    page = template.render(found=shown, search_drawn=True)
    assert "3 generations so far" in page
    assert "It ended: the budget of 30 cases is spent." in page
    assert f"<code>{shown.clusters[0].mildest}</code>" in page


def test_the_figure_has_every_case_and_every_answer(found: SearchFile) -> None:
    figure = search_figure(found)
    assert figure is not None
    cases, limit, answers = figure["data"]
    assert len(cases["text"]) == 30
    assert cases["text"][0] == "<b>g0000-0000</b>"
    assert limit["mode"] == "lines"
    assert len(answers["hovertemplate"]) > 0
    assert len(found.generations) == 3


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
        '{% include "search.html.j2" with context %}'
    )
    page = template.render(found=search_shown(traced), search_drawn=True)
    assert '<div id="boundary"></div>' in page
    assert "Boundary in objects.a.start_s and objects.a.offset_m; " in page


def test_a_formula_is_told(found: SearchFile) -> None:
    formula = "always (ttc_s > 1.0)"
    shown = search_shown(msgspec.structs.replace(found, formula=formula, kpi="robustness"))
    assert shown is not None
    assert shown.title == f"A case fails if it breaks: {formula}."
