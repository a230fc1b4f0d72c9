"""The bench of searches: simulated workers are busier with chains."""

from __future__ import annotations

from dataclasses import replace

import pytest

from conductor.bench.search import SearchLoad, measure_search
from twin.base.errors import UsageError

LOAD = SearchLoad(chains=1, generation=16, cases=640, slots=20, spread=0.5, sampler="monte_carlo")


def test_chains_keep_slots_busy() -> None:
    one, many = measure_search(LOAD), measure_search(replace(LOAD, chains=8))
    assert (one.cases, one.generations) == (many.cases, many.generations) == (640, 40)
    assert one.busy < 0.5
    assert many.busy > 0.85
    assert measure_search(LOAD).busy == one.busy, "time is simulated"


def test_a_sampler_that_is_none_is_told() -> None:
    with pytest.raises(UsageError, match="sampler: no 'annealing'"):
        measure_search(replace(LOAD, sampler="annealing"))
