"""Indices of two functions whose indices are known, and where there are none."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from search_bench import KPI, LimitState, normal_section, section
from search_closed import closed_of

from conductor.search.answers.case_rows import SearchRows, case_rows
from conductor.search.answers.indices import search_indices
from conductor.search.samplers.saltelli import rows_of
from schemas.files.search_result import SearchIndices
from schemas.sections.search import Search

ISHIGAMI_FIRST, ISHIGAMI_TOTAL = (0.3139, 0.4424, 0.0), (0.5576, 0.4424, 0.2437)
"""Ishigami and Homma, 1990, with a = 7 and b = 0.1."""


def ishigami(x: list[float]) -> float:
    return math.sin(x[0]) + 7.0 * math.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * math.sin(x[0])


G = (0.0, 1.0, 4.5, 9.0)


def g_function(x: list[float]) -> float:
    """Sobol's function, less a limit."""
    return math.prod((abs(4.0 * v - 2.0) + a) / (1.0 + a) for v, a in zip(x, G, strict=True)) - 0.5


def g_truth() -> tuple[list[float], list[float]]:
    parts = [1.0 / (3.0 * (1.0 + a) ** 2) for a in G]
    whole = math.prod(1.0 + part for part in parts) - 1.0
    totals = [part * (whole + 1.0) / (1.0 + part) / whole for part in parts]
    return [part / whole for part in parts], totals


def _searched(
    form: LimitState, sampler: str, dimension: int, ends: tuple[float, float], cases: int
) -> tuple[Search, SearchIndices | None]:
    uniform = {"distribution": "uniform", "low": ends[0], "high": ends[1]}
    names = [f"objects.o{index}.start_s" for index in range(dimension)]
    search = msgspec.convert(
        section(
            sampler,
            parameters=dict.fromkeys(names, uniform),
            budget={"cases": cases, "generation": cases // 4},
        ),
        Search,
    )
    rows = case_rows(search, closed_of(search, 3, form))
    return search, search_indices(search, "c", 3, rows)


def test_a_design_knows_ishigami() -> None:
    _, found = _searched(ishigami, "sensitivity", 3, (-math.pi, math.pi), 5 * 1024)
    assert found is not None
    assert "1024 rows" in found.method
    for index, first, total in zip(found.kpi, ISHIGAMI_FIRST, ISHIGAMI_TOTAL, strict=True):
        assert index.first_low <= first <= index.first_high
        assert index.first_high - index.first_low < 0.13
        assert index.total_low is not None
        assert index.total_high is not None
        assert index.total_low <= total <= index.total_high
        assert index.total == pytest.approx(total, abs=0.03)
    assert [index.parameter for index in found.failure] == [
        f"objects.o{i}.start_s" for i in range(3)
    ]


def test_a_design_knows_the_g_function() -> None:
    _, found = _searched(g_function, "sensitivity", 4, (0.0, 1.0), 6 * 512)
    assert found is not None
    for index, first, total in zip(found.kpi, *g_truth(), strict=True):
        assert index.first == pytest.approx(first, abs=0.04)
        assert index.total == pytest.approx(total, abs=0.03)


@pytest.mark.parametrize("sampler", ["monte_carlo", "latin_hypercube", "sobol"])
def test_given_data_know_the_first_order(sampler: str) -> None:
    _, found = _searched(ishigami, sampler, 3, (-math.pi, math.pi), 4096)
    assert found is not None
    assert found.method.startswith("first order from given data, by classes of each parameter;")
    for index, first in zip(found.kpi, ISHIGAMI_FIRST, strict=True):
        assert index.first == pytest.approx(first, abs=0.04)
        assert index.first_low <= index.first <= index.first_high
        assert index.total is None


def test_points_that_do_not_follow_the_distributions_say_so() -> None:
    search = msgspec.convert(normal_section(2, "importance"), Search)
    u = np.random.default_rng(1).standard_normal((200, 2))
    values = [[float(a), float(b)] for a, b in u]
    found = search_indices(search, "c", 1, SearchRows(values, u, 1.0 - u[:, 0]))
    assert found is not None
    assert "over the cases as proposed, not over the distributions" in found.method


def test_words_have_a_class_each() -> None:
    choices = {"distribution": "choices", "values": ["clear", "snow"]}
    normal = {"distribution": "normal", "mean": 0.0, "sd": 1.0}
    parameters = {"weather": choices, "objects.a.start_s": normal}
    search = msgspec.convert(section(parameters=parameters), Search)
    u = np.random.default_rng(1).standard_normal((400, 2))
    values = [["snow" if a > 0 else "clear", float(b)] for a, b in u]
    found = search_indices(search, "c", 1, SearchRows(values, u, np.where(u[:, 0] > 0, -1.0, 1.0)))
    assert found is not None
    assert [round(index.first, 3) for index in found.failure] == [1.0, 0.0]


def test_few_cases_few_failures_and_no_variance_give_none() -> None:
    search = msgspec.convert(normal_section(2, "monte_carlo"), Search)
    u = np.random.default_rng(1).standard_normal((200, 2))
    values = [[float(a), float(b)] for a, b in u]
    assert search_indices(search, "c", 1, SearchRows(values[:99], u[:99], u[:99, 0])) is None
    still = search_indices(search, "c", 1, SearchRows(values, u, np.ones(200)))
    assert still is not None
    assert (still.kpi, still.failure) == ([], [])
    rare = search_indices(search, "c", 1, SearchRows(values, u, u[:, 0] + 1.8))
    assert rare is not None
    assert 0 < np.count_nonzero(u[:, 0] + 1.8 < 0) < 10
    assert len(rare.kpi) == 2
    assert rare.failure == []


def test_a_design_fits_its_budget_and_repeats() -> None:
    assert [rows_of(3, cases) for cases in (4, 5, 24, 25)] == [0, 1, 4, 4]
    assert rows_of(3, 40) == 8
    search, found = _searched(ishigami, "sensitivity", 3, (-math.pi, math.pi), 400)
    closed = closed_of(search, 3, ishigami)
    assert [len(rows) for rows in closed.u] == [80] * 5
    again = search_indices(search, "c", 3, case_rows(search, closed))
    assert again == found
    assert search.objective.kpi == KPI
