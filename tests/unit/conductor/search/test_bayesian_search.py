"""Bayesian search finds known minima, with far fewer cases than random points."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest
from scipy.special import ndtr
from search_bench import KPI, section

from conductor.search.driver import Closed, first, follow
from conductor.search.samplers.bayesian import improvement
from conductor.search.samplers.gaussian_process import FITTED_MAX, Surrogate
from schemas.sections.search import Search

SEEDS = range(10)
BRANIN = 0.397887
HARTMANN = -3.32237
SECOND = -3.2032
"""The second deepest minimum of Hartmann's function; that of ten runs some end in it is known of
searches by expected improvement."""

_WEIGHTS = np.array([1.0, 1.2, 3.0, 3.2])
_SCALES = np.array(
    [
        [10, 3, 17, 3.5, 1.7, 8],
        [0.05, 10, 17, 0.1, 8, 14],
        [3, 3.5, 1.7, 10, 17, 8],
        [17, 8, 0.05, 10, 0.1, 14],
    ]
)
_CENTRES = 1e-4 * np.array(
    [
        [1312, 1696, 5569, 124, 8283, 5886],
        [2329, 4135, 8307, 3736, 1004, 9991],
        [2348, 1451, 3522, 2883, 3047, 6650],
        [4047, 8828, 8732, 5743, 1091, 381],
    ]
)


def branin(values: list[float]) -> float:
    """Branin's function on -5 to 10, 0 to 15; three minima of 0.397887."""
    x, y = values
    bowl = y - 5.1 / (4 * math.pi**2) * x * x + 5 / math.pi * x - 6
    return bowl * bowl + 10 * (1 - 1 / (8 * math.pi)) * math.cos(x) + 10


def hartmann(values: list[float]) -> float:
    """Hartmann's function of six parameters from 0 to 1; its least minimum is -3.32237."""
    apart = np.sum(_SCALES * (np.array(values) - _CENTRES) ** 2, axis=1)
    return -float(np.sum(_WEIGHTS * np.exp(-apart)))


def _section(boxes: list[tuple[float, float]], cases: int, generation: int) -> Search:
    parameters = {
        f"objects.o{index}.start_s": {"distribution": "uniform", "low": low, "high": high}
        for index, (low, high) in enumerate(boxes)
    }
    made: dict[str, Any] = section(
        "bayesian",
        parameters=parameters,
        objective={"kpi": KPI, "goal": "least"},
        budget={"cases": cases, "generation": generation},
    )
    return msgspec.convert(made, Search)


def _found(form: Callable[[list[float]], float], search: Search, seed: int) -> list[float]:
    """Values in the order of proposals."""
    proposal = first(search, "found", seed)
    u, results = [], list[list[float | None]]()
    while proposal is not None:
        u.append(proposal.u)
        results.append([form(list(map(float, row))) for row in proposal.values])
        proposal = follow(search, "found", seed, Closed(u, results)).proposal
    return [value for part in results for value in part if value is not None]


def _random_cases(
    form: Callable[[list[float]], float], boxes: list[tuple[float, float]], level: float
) -> float:
    """How many random cases it takes on the average to come below a level, at least."""
    numbers = np.random.default_rng(1)
    low, high = np.array(boxes).T
    points = low + (high - low) * numbers.random((20_000, len(boxes)))
    hits = sum(form(list(point)) <= level for point in points)
    return len(points) / max(hits, 1)


def test_the_minimum_of_branin_is_found_in_40_cases() -> None:
    boxes, level = [(-5.0, 10.0), (0.0, 15.0)], BRANIN + 0.05
    for seed in SEEDS:
        assert min(_found(branin, _section(boxes, 40, 5), seed)) <= level, seed
    assert _random_cases(branin, boxes, level) > 10 * 40


@pytest.mark.slow
def test_a_deep_minimum_of_hartmann_is_found_in_100_cases() -> None:
    boxes, level = [(0.0, 1.0)] * 6, SECOND + 0.02
    least = [min(_found(hartmann, _section(boxes, 100, 10), seed)) for seed in SEEDS]
    assert max(least) <= level
    assert sum(value <= HARTMANN + 0.1 for value in least) >= 5
    assert _random_cases(hartmann, boxes, level) > 100 * 100


def test_expected_improvement_is_that_of_a_normal_variable() -> None:
    numbers = np.random.default_rng(2)
    draws = 0.3 + 0.5 * numbers.standard_normal(1_000_000)
    expected = float(np.mean(np.maximum(0.1 - draws, 0.0)))
    mine = float(improvement(np.array([0.3]), np.array([0.25]), 0.1)[0])
    assert mine == pytest.approx(expected, rel=0.01)


def test_a_believed_case_shrinks_what_is_unknown_as_a_real_one_does() -> None:
    numbers = np.random.default_rng(3)
    places = numbers.random((20, 2))
    margins = np.sin(5 * places[:, 0]) + places[:, 1]
    process = Surrogate(places, margins)
    candidates = process.at(numbers.random((30, 2)))
    before = candidates.variance.copy()
    process.believe(candidates, 4)
    joined = np.vstack([places, candidates.places[4]])
    kernel, noise = process.kernel(joined, joined), process.noise + 1e-8
    between = process.kernel(joined, candidates.places)
    solved = np.linalg.solve(kernel + noise * np.eye(21), between)
    direct = process.kernel(candidates.places, candidates.places).diagonal()
    direct = direct - np.sum(between * solved, axis=0)
    np.testing.assert_allclose(candidates.variance, np.maximum(direct, 0), atol=1e-7)
    assert np.all(candidates.variance <= before)


def test_many_cases_and_equal_margins_are_no_trouble() -> None:
    numbers = np.random.default_rng(4)
    places = numbers.random((FITTED_MAX + 30, 3))
    flat = Surrogate(places, np.zeros(len(places))).at(places[:5])
    assert np.all(np.isfinite(flat.mean))
    many = Surrogate(places, places[:, 0]).at(places[:5])
    assert float(np.max(np.abs(many.mean - np.clip(many.mean, -3, 3)))) == 0.0


def test_the_last_generation_takes_what_the_budget_leaves() -> None:
    search = _section([(0.0, 1.0)] * 2, 23, 10)
    assert len(_found(lambda values: sum(values), search, 0)) == 23
    proposal = first(search, "found", 0)
    assert np.all((ndtr(np.array(proposal.u)) > 0) & (ndtr(np.array(proposal.u)) < 1))
