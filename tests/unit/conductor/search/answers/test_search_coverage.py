"""What was tried of a domain: cells, their probabilities, and those without a case."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest
from search_bench import section

from conductor.search.answers.case_rows import SearchRows
from conductor.search.answers.coverage import Axis, coverage_of
from conductor.search.answers.domain import search_coverage
from conductor.search.space import values_of
from schemas.files.search_result import SearchCoverage
from schemas.sections.search import Search

A, B = "objects.a.start_s", "objects.b.start_s"


def _covered(
    parameters: dict[str, Any], count: int = 200_000, **changes: Any
) -> tuple[SearchCoverage, int]:
    search = msgspec.convert(section(parameters=parameters, **changes), Search)
    u = np.random.default_rng(1).standard_normal((count, len(parameters)))
    rows = SearchRows(values_of(search, u), u, u[:, 0])
    return search_coverage(search, rows), count


@pytest.mark.parametrize(
    "distribution",
    [
        {"distribution": "uniform", "low": -2.0, "high": 4.0},
        {"distribution": "uniform", "low": 0.0, "high": 400.0, "whole": True},
        {"distribution": "normal", "mean": 3.0, "sd": 0.5},
        {"distribution": "truncated_normal", "mean": 0.0, "sd": 1.0, "low": 1.0, "high": 2.0},
        {"distribution": "lognormal", "median": 2.0, "sigma": 0.5},
        {"distribution": "exponential", "mean": 3.0, "low": 1.0},
        {"distribution": "triangular", "low": 0.0, "mode": 3.0, "high": 4.0},
        {"distribution": "integers", "low": 2, "high": 20},
        {"distribution": "choices", "values": [10, 20, 30], "weights": [1, 0, 3]},
    ],
)
def test_cells_have_the_probability_of_their_cases(distribution: dict[str, Any]) -> None:
    found, count = _covered({A: distribution})
    one = found.parameters[0]
    assert sum(one.weights) == pytest.approx(1.0, abs=1e-5)
    for weight, cases in zip(one.weights, one.cases, strict=True):
        assert cases / count == pytest.approx(weight, abs=0.005)
    assert found.untried == []
    assert found.pairs == []


def test_cells_are_named_by_what_is_in_them() -> None:
    def labels(distribution: dict[str, Any], **domain: Any) -> list[str]:
        domains = {"domain": {A: domain}} if domain else {}
        return _covered({A: distribution}, 10, **domains)[0].parameters[0].cells

    uniform = {"distribution": "uniform", "low": 0.0, "high": 1.0}
    assert labels(uniform, bins=4) == ["0 to 0.25", "0.25 to 0.5", "0.5 to 0.75", "0.75 to 1"]
    assert labels(uniform, edges=[0.1]) == ["0 to 0.1", "0.1 to 1"]
    whole = {**uniform, "high": 10.0, "whole": True}
    assert labels(whole, edges=[2.5, 5.0]) == ["0 to 2", "3 to 4", "5 to 10"]
    normal = {"distribution": "normal", "mean": 0.0, "sd": 1.0}
    assert labels(normal, edges=[-1.0, 1.0]) == ["below -1", "-1 to 1", "1 and more"]
    few = {"distribution": "integers", "low": 2, "high": 4}
    assert labels(few) == ["2", "3", "4"]
    many = {"distribution": "choices", "values": list(range(40))}
    assert labels(many)[-2:] == ["30", "9 others"]


@pytest.mark.parametrize("rho", [0.0, 0.7, -0.95])
def test_pairs_have_the_probability_of_their_cases(rho: float) -> None:
    normal = {"distribution": "normal", "mean": 0.0, "sd": 1.0}
    related = [{"between": [A, B], "rho": rho}] if rho else []
    domain = {A: {"bins": 4}, B: {"edges": [-1.0, 0.0, 2.0]}}
    found, count = _covered({A: normal, B: normal}, correlations=related, domain=domain)
    pair = found.pairs[0]
    assert pair.parameters == [A, B]
    weights, cases = np.array(pair.weights), np.array(pair.cases)
    assert weights.sum() == pytest.approx(1.0, abs=1e-4)
    assert np.abs(cases / count - weights).max() < 0.005
    assert pair.untried == pytest.approx(float(weights[cases == 0].sum()), abs=1e-9)


def test_what_was_never_tried_is_listed_by_its_probability() -> None:
    halves = np.array([0.5, 0.5])
    one = Axis("one", ["a", "b"], np.array([0.7, 0.3]), np.array([0, 0, 1]))
    two = Axis("two", ["x", "y"], halves, np.array([0, 1, 0]))
    three = Axis("three", ["p", "q"], np.array([0.9, 0.1]), np.array([0, 0, 0]))
    found = coverage_of([one, two, three])
    assert found.cases == 3
    told = [(cell.parameters, cell.cells, cell.weight) for cell in found.untried]
    # A pair with q is not named: q itself was not tried.
    assert told == [(["one", "two"], ["b", "y"], 0.15), (["three"], ["q"], 0.1)]
    pairs = {tuple(pair.parameters): pair for pair in found.pairs}
    pair = pairs["one", "two"]
    assert (pair.possible, pair.tried, pair.untried) == (4, 3, 0.15)
    assert pairs["one", "three"].untried == pytest.approx(0.1)
    assert pairs["two", "three"].tried == 2


def test_impossible_cells_need_not_be_tried() -> None:
    never = {"distribution": "choices", "values": ["a", "b", "c"], "weights": [1, 1, 0]}
    uniform = {"distribution": "uniform", "low": 0.0, "high": 1.0}
    found, _ = _covered({"weather": never, A: uniform}, 500, domain={A: {"edges": [0.5, 2.0]}})
    assert (found.pairs[0].possible, found.pairs[0].tried) == (4, 4)
    assert found.untried == []
