"""The map of failures: a known boundary, and what has none."""

from __future__ import annotations

import msgspec
import numpy as np
from search_bench import normal_section, section

from conductor.search.answers.case_rows import SearchRows
from conductor.search.answers.failure_map import failure_map
from conductor.search.answers.indices import search_indices
from conductor.search.space import values_of
from schemas.files.search_result import FailureMap
from schemas.sections.search import Search


def _mapped(search: Search, u: np.ndarray, g: np.ndarray) -> FailureMap | None:
    rows = SearchRows(values_of(search, u), u, g)
    return failure_map(search, rows, search_indices(search, "c", 1, rows))


def test_a_line_is_found_in_the_two_parameters_that_make_it() -> None:
    search = msgspec.convert(normal_section(4, "monte_carlo"), Search)
    u = np.random.default_rng(1).standard_normal((2000, 4))
    found = _mapped(search, u, 2.0 * u[:, 3] + u[:, 1] - 0.5)
    assert found is not None
    assert found.parameters == ["objects.o3.start_s", "objects.o1.start_s"]
    assert "of the 45 nearest of 2000 cases, nearer ones" in found.method
    wrong = told = 0
    for y, row in zip(found.y, found.share, strict=True):
        for x, share in zip(found.x, row, strict=True):
            margin = 2.0 * x + y - 0.5
            if share is None:
                assert abs(x) > 2.0 or abs(y) > 2.0
            elif abs(margin) > 0.6:
                told += 1
                wrong += (share > 0.5) != (margin < 0)
    assert told > 500
    assert wrong <= 0.01 * told


def test_points_of_a_sampler_that_looks_for_failures_say_so() -> None:
    search = msgspec.convert(normal_section(2, "importance"), Search)
    u = np.random.default_rng(1).standard_normal((300, 2))
    found = _mapped(search, u, u[:, 0])
    assert found is not None
    assert "which do not follow the distributions" in found.method


def test_one_number_few_failures_or_no_limit_have_no_map() -> None:
    u = np.random.default_rng(1).standard_normal((300, 2))
    numbers = msgspec.convert(normal_section(2, "monte_carlo"), Search)
    assert _mapped(numbers, u, u[:, 0] + 2.6) is None
    words = {"distribution": "choices", "values": ["clear", "light_snow"]}
    normal = {"distribution": "normal", "mean": 0.0, "sd": 1.0}
    mixed = section(parameters={"weather": words, "objects.a.start_s": normal})
    assert _mapped(msgspec.convert(mixed, Search), u, u[:, 0]) is None
    goal = normal_section(2, "cma_es", objective={"kpi": "dtc_min_m", "goal": "least"})
    assert _mapped(msgspec.convert(goal, Search), u, u[:, 0]) is None


def test_values_of_the_map_are_those_of_the_distributions() -> None:
    uniform = {"distribution": "uniform", "low": 10.0, "high": 20.0}
    names = ["objects.a.start_s", "objects.b.start_s"]
    data = section(parameters=dict.fromkeys(names, uniform))
    data["correlations"] = [{"between": names, "rho": 0.8}]
    search = msgspec.convert(data, Search)
    u = np.random.default_rng(1).standard_normal((500, 2))
    found = _mapped(search, u, u[:, 0] + 0.1 * u[:, 1])
    assert found is not None
    for values in (found.x, found.y):
        assert values == sorted(values)
        assert 10.0 <= values[0] < 10.2
        assert 19.8 < values[-1] <= 20.0
    assert any(share is None for row in found.share for share in row)  # no case in two corners
