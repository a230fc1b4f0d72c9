"""Chains side by side: their histories, their one answer, their places to start."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from search_bench import KPI, normal_section, section, solve, tilted

from conductor.search.chains import history_of, mean_of
from conductor.search.driver import first
from conductor.search.intervals import lognormal, relative_error
from conductor.search.protocol import History
from schemas.files.search_result import ChainEstimate
from schemas.sections.search import Search


def _estimate(probability: float, relative: float) -> ChainEstimate:
    low, high = lognormal(probability, relative)
    return ChainEstimate("m", probability, low, high)


def test_a_chain_has_its_generations_alone() -> None:
    whole = History([np.full((1, 1), i) for i in range(5)], [np.full(1, i) for i in range(5)])
    assert [float(g[0]) for g in history_of(1, whole, [0, 1, 2, 1, 0]).g] == [1.0, 3.0]
    assert history_of(0, whole, ()) is whole


def test_an_interval_tells_its_relative_error() -> None:
    for relative in (0.05, 0.3, 1.0):
        low, _ = lognormal(1e-3, relative)
        assert relative_error(1e-3, low) == pytest.approx(relative)
    assert relative_error(0.0, 0.0) == relative_error(0.5, None) == 0.0


def test_a_mean_has_the_larger_of_two_errors() -> None:
    alike = mean_of(4, [_estimate(1e-3, 0.2)] * 4)
    assert alike.probability == pytest.approx(1e-3)
    assert (alike.low, alike.high) == pytest.approx(lognormal(1e-3, 0.1))
    apart = mean_of(2, [_estimate(1e-3, 0.01), _estimate(3e-3, 0.01)])
    assert apart.probability == pytest.approx(2e-3)
    assert (apart.low, apart.high) == pytest.approx(lognormal(2e-3, 0.5))


def test_a_mean_waits_for_every_chain() -> None:
    part = mean_of(3, [_estimate(1e-3, 0.2), ChainEstimate("the density still moves")])
    assert part.probability is None
    assert part.method == "mean of 3 chains; 1 of them have an answer"
    none = mean_of(2, [ChainEstimate("m", 0.0, 0.0, 0.01), ChainEstimate("m", 0.0, 0.0, 0.02)])
    assert (none.probability, none.low, none.high) == (0.0, 0.0, 0.01)


@pytest.mark.parametrize("sampler", ["monte_carlo", "sobol", "importance", "subset"])
def test_four_chains_know_a_plane(sampler: str) -> None:
    options = {"level": 200} if sampler == "subset" else {}
    budget = {"cases": 6400, "generation": 200}
    answer = solve(
        normal_section(2, sampler, budget=budget, options=options, chains=4), 1, tilted(2.0)
    )
    assert answer.low is not None
    assert answer.high is not None
    assert answer.low < 0.02275 < answer.high
    assert answer.high - answer.low < 0.02


def test_chains_begin_elsewhere_and_their_budget_is_shared() -> None:
    least = {"kpi": KPI, "goal": "least"}
    search = section("cma_es", objective=least, budget={"cases": 80, "generation": 10}, chains=4)
    begun = [first(msgspec.convert(search, Search), "c", 1, chain).u for chain in range(4)]
    middles = np.array([np.mean(u, axis=0) for u in begun])
    assert np.linalg.norm(middles[0]) < 1.5
    assert np.ptp(middles, axis=0).max() > 1.0
    small = msgspec.convert({**search, "budget": {"cases": 39, "generation": 10}}, Search)
    with pytest.raises(ValueError, match="39 cases are too few for one generation of cma_es in ea"):
        first(small, "c", 1)
