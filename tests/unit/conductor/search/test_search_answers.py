"""Samplers on closed forms: answers, intervals, clusters, and values of distributions."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from search_bench import KPI, four_branches, normal_section, plane, section, solve, sphere, tilted

from conductor.search.driver import Closed, clusters, first, follow
from conductor.search.intervals import wilson
from conductor.search.space import values_of
from schemas.searching.search_points import Z_MAX
from schemas.sections.search import Search

PLANE = 0.0668072
BRANCHES = 0.0044636
"""By 20 million points."""


def _section(**parameters: dict[str, Any]) -> Search:
    named = {f"objects.{name}.start_s": value for name, value in parameters.items()}
    return msgspec.convert(section(parameters=named), Search)


def _cases(cases: int, generation: int) -> dict[str, int]:
    return {"cases": cases, "generation": generation}


@pytest.mark.parametrize("sampler", ["monte_carlo", "latin_hypercube", "sobol"])
def test_points_that_do_not_look_at_results_know_a_plane(sampler: str) -> None:
    answer = solve(normal_section(2, sampler, budget=_cases(640, 64)), 3, plane)
    assert answer.low is not None
    assert answer.high is not None
    assert answer.low < PLANE < answer.high
    assert answer.high - answer.low < 0.06


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sampler", "budget", "options"),
    [("importance", _cases(3000, 500), {}), ("subset", _cases(5000, 50), {"level": 1000})],
)
def test_rare_failures_are_found(
    sampler: str, budget: dict[str, int], options: dict[str, Any]
) -> None:
    for seed in range(3):
        for form, dimension, truth in (
            (four_branches, 2, BRANCHES),
            (tilted(3.719016), 3, 1e-4),
            (sphere(5.963), 10, 1.0e-4),
        ):
            search = normal_section(dimension, sampler, budget=budget, options=options)
            answer = solve(search, seed, form)
            assert answer.probability is not None, (sampler, truth, seed)
            assert 0.4 * truth < answer.probability < 2.5 * truth, (sampler, truth, seed)


def test_an_evolution_goes_to_the_extreme() -> None:
    def bowl(values: list[float]) -> float:
        return (values[0] - 1.0) ** 2 + (values[1] + 2.0) ** 2

    search = normal_section(
        2, "cma_es", objective={"kpi": KPI, "goal": "least"}, budget=_cases(200, 10)
    )
    answer = solve(search, 1, bowl)
    assert answer.best is not None
    assert answer.best < 1e-3
    assert answer.probability is None


def test_wilson_without_a_failure_begins_at_nothing() -> None:
    low, high = wilson(0, 100)
    assert low == 0.0
    assert high == pytest.approx(0.03699, abs=1e-4)


def test_a_budget_too_small_for_a_generation_is_told() -> None:
    search = normal_section(2, "subset", budget=_cases(10, 5))
    with pytest.raises(ValueError, match="10 cases are too few for one generation of subset"):
        first(msgspec.convert(search, Search), "c", 1)


def test_values_have_their_distributions() -> None:
    u = np.random.Generator(np.random.Philox(1)).standard_normal((20_000, 8))
    search = _section(
        a={"distribution": "uniform", "low": -2.0, "high": 4.0},
        b={"distribution": "normal", "mean": 3.0, "sd": 0.5},
        c={"distribution": "truncated_normal", "mean": 0.0, "sd": 1.0, "low": 1.0, "high": 2.0},
        d={"distribution": "lognormal", "median": 2.0, "sigma": 0.5},
        e={"distribution": "exponential", "mean": 3.0, "low": 1.0},
        f={"distribution": "triangular", "low": 0.0, "mode": 3.0, "high": 4.0},
        g={"distribution": "integers", "low": 2, "high": 4},
        h={"distribution": "choices", "values": [10, 20], "weights": [1, 3]},
    )
    rows = values_of(search, u)
    a, b, c, d, e, f, g, h = (np.array(column, np.float64) for column in zip(*rows, strict=True))
    assert a.mean() == pytest.approx(1.0, abs=0.05)
    assert (a.min() >= -2.0, a.max() <= 4.0) == (True, True)
    assert (b.mean(), b.std()) == (pytest.approx(3.0, abs=0.02), pytest.approx(0.5, abs=0.01))
    assert c.mean() == pytest.approx(1.3832, abs=0.01)
    assert (c.min() >= 1.0, c.max() <= 2.0) == (True, True)
    assert np.median(d) == pytest.approx(2.0, abs=0.03)
    assert e.mean() == pytest.approx(4.0, abs=0.1)
    assert e.min() >= 1.0
    assert f.mean() == pytest.approx(7 / 3, abs=0.03)
    assert [float(np.mean(g == n)) for n in (2, 3, 4)] == pytest.approx([1 / 3] * 3, abs=0.02)
    assert float(np.mean(h == 20)) == pytest.approx(0.75, abs=0.02)
    assert all(isinstance(row[6], int) for row in rows)
    assert all(row[0] == float(f"{row[0]:.9g}") for row in rows)


def test_correlated_parameters_move_together() -> None:
    data = section(
        correlations=[{"between": ["objects.a.start_s", "objects.a.offset_m"], "rho": -0.7}]
    )
    u = np.random.Generator(np.random.Philox(2)).standard_normal((20_000, 2))
    rows = np.array(values_of(msgspec.convert(data, Search), u), np.float64)
    assert float(np.corrcoef(rows.T)[0, 1]) == pytest.approx(-0.7, abs=0.02)


def test_coordinates_beyond_reason_stay_finite() -> None:
    search = _section(
        a={"distribution": "exponential", "mean": 1.0},
        b={"distribution": "truncated_normal", "mean": 0.0, "sd": 1.0, "low": 7.0, "high": 9.0},
    )
    for row in values_of(search, np.array([[40.0, 40.0], [-40.0, -40.0]])):
        assert all(math.isfinite(float(value)) for value in row)
    assert values_of(search, np.array([[40.0, 0.0]])) == values_of(search, np.array([[Z_MAX, 0.0]]))


def test_failures_on_two_sides_are_two_clusters() -> None:
    search = msgspec.convert(section(), Search)
    u = [[[3.0, 0.0], [3.2, 0.1], [-3.0, 0.0], [0.0, 0.0], [3.1, -0.2]]]
    found = clusters(search, Closed(u, [[-0.1, -0.5, -0.2, 1.0, -0.3]]))
    assert [cluster.cases for cluster in found] == [
        ["g0000-0000", "g0000-0004", "g0000-0001"],
        ["g0000-0002"],
    ]
    assert [cluster.mildest for cluster in found] == ["g0000-0000", "g0000-0002"]
    assert found[0].kpi == -0.1


def test_of_equal_failures_the_slowest_impact_is_the_mildest() -> None:
    search = msgspec.convert(section(), Search)
    u = [[[3.0, 0.0], [3.2, 0.1], [3.1, -0.2]], [[3.0, 0.3], [-3.0, 0.0], [-3.1, 0.0]]]
    speeds = {"g0000-0000": 9.0, "g0000-0002": 0.5, "g0001-0000": 4.0, "g0001-0001": 7.0}
    closed = Closed(u, [[-1.0, -0.5, -1.0], [-1.0, -1.0, -1.0]])
    found = clusters(search, closed, lambda name: speeds.get(name, 2.0))
    assert [cluster.cases for cluster in found] == [
        ["g0000-0001", "g0000-0002", "g0001-0000", "g0000-0000"],
        ["g0001-0002", "g0001-0001"],
    ]
    alike = clusters(search, closed, lambda _: 3.0)
    assert alike == clusters(search, closed), "the first proposed of equal ones"
    assert alike[1].mildest == "g0001-0001"


def test_a_step_depends_on_its_arguments_alone() -> None:
    search = msgspec.convert(section("cma_es", objective={"kpi": KPI, "goal": "least"}), Search)
    begun = first(search, "c", 4)
    closed = Closed([begun.u], [[plane(row) for row in begun.u]])
    np.random.seed(0)
    one = follow(search, "c", 4, closed)
    np.random.seed(1)
    follow(search, "other", 9, closed)
    assert follow(search, "c", 4, closed) == one
