"""How often the intervals of samplers cover the truth, on closed forms.

``PYTHONPATH=tests python tests/search_coverage.py [--seeds 1000] [--only importance]`` prints a
table: of how many seeds the 95 % interval covers, of how many there was none, the mean of the
estimates over the truth, their spread, cases, and how many times more of them Monte Carlo needs
for the same error.
"""

from __future__ import annotations

import argparse
import math
from typing import Any, NamedTuple

import numpy as np
from search_bench import LimitState, four_branches, normal_section, solve, sphere, tilted


class Problem(NamedTuple):
    """A limit state with its known probability, and what it is solved with."""

    name: str
    form: LimitState
    dimension: int
    truth: float
    sampler: str
    budget: dict[str, Any]
    options: dict[str, Any]


def _many(cases: int, generation: int) -> dict[str, int]:
    return {"cases": cases, "generation": generation}


FORMS: tuple[tuple[str, LimitState, int, float], ...] = (
    ("plane 1e-3, 2", tilted(3.090232), 2, 1e-3),
    ("four branches", four_branches, 2, 0.0044636),
    ("plane 1e-4, 10", tilted(3.719016), 10, 1e-4),
    ("sphere 1e-4, 10", sphere(5.963234), 10, 1e-4),
    ("plane 1e-5, 4", tilted(4.264891), 4, 1e-5),
    ("plane 1e-6, 4", tilted(4.753424), 4, 1e-6),
)
"""Name, limit state, parameters, probability of failure."""

PROBLEMS = (
    *(
        Problem("plane 0.0668, 2", tilted(1.5), 2, 0.0668072, sampler, _many(1024, 64), {})
        for sampler in ("monte_carlo", "latin_hypercube", "sobol")
    ),
    *(Problem(*form, "importance", _many(4000, 500), {}) for form in FORMS),
    *(Problem(*form, "subset", _many(8000, 50), {"level": 1000}) for form in FORMS),
)


def row(problem: Problem, seeds: int) -> str:
    """One line of the table."""
    section = normal_section(
        problem.dimension, problem.sampler, budget=problem.budget, options=problem.options
    )
    answers = [solve(section, seed, problem.form) for seed in range(seeds)]
    told = [a for a in answers if a.low is not None and a.high is not None]
    covered = sum((a.low or 0.0) <= problem.truth <= (a.high or 0.0) for a in told)
    estimates = np.array([a.probability for a in told], np.float64) / problem.truth
    cases = float(np.mean([a.cases for a in answers]))
    error = math.sqrt(float(np.mean((estimates - 1.0) ** 2))) if told else math.nan
    by_chance = (1 - problem.truth) / problem.truth / error**2
    none = seeds - len(told)
    return (
        f"{problem.name:16} {problem.sampler:16} {covered:5} of {len(told):4}, none {none:3}"
        f"  mean {np.mean(estimates):.3f}  error {error:.3f}  cases {cases:6.0f}"
        f"  gain {by_chance / cases:8.1f}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=1000)
    parser.add_argument("--only", default="", help="name of a sampler")
    given = parser.parse_args()
    for problem in PROBLEMS:
        if given.only in ("", problem.sampler):
            print(row(problem, given.seeds), flush=True)


if __name__ == "__main__":
    main()
