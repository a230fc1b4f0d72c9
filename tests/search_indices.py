"""How often the intervals of sensitivity indices cover the truth, on Ishigami's function.

``PYTHONPATH=tests python tests/search_indices.py [--seeds 200]`` prints a line per sampler: for how
many seeds the 95 % intervals of each parameter cover, of first and of total order.
"""

from __future__ import annotations

import argparse
import math

import msgspec
import numpy as np
from search_bench import section
from search_closed import closed_of

from conductor.search.answers.case_rows import case_rows
from conductor.search.answers.indices import search_indices
from schemas.sections.search import Search

FIRST, TOTAL = (0.3139, 0.4424, 0.0), (0.5576, 0.4424, 0.2437)
UNIFORM = {"distribution": "uniform", "low": -math.pi, "high": math.pi}
SEARCHES = (
    ("sensitivity", 2560, 640),
    ("monte_carlo", 2000, 1000),
    ("monte_carlo", 400, 200),
    ("sobol", 2048, 512),
)
"""Sampler, cases, cases of a generation."""


def ishigami(x: list[float]) -> float:
    """Ishigami and Homma, 1990, with a = 7 and b = 0.1."""
    return math.sin(x[0]) + 7.0 * math.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * math.sin(x[0])


def line(sampler: str, cases: int, generation: int, seeds: int) -> str:
    """One line of the table."""
    names = [f"objects.o{index}.start_s" for index in range(3)]
    budget = {"cases": cases, "generation": generation}
    data = section(sampler, parameters=dict.fromkeys(names, UNIFORM), budget=budget)
    search = msgspec.convert(data, Search)
    first, total = np.zeros(3, int), np.zeros(3, int)
    for seed in range(seeds):
        rows = case_rows(search, closed_of(search, seed, ishigami))
        found = search_indices(search, "c", seed, rows)
        assert found is not None
        first += [i.first_low <= t <= i.first_high for i, t in zip(found.kpi, FIRST, strict=True)]
        total += [
            i.total_low is not None
            and i.total_high is not None
            and i.total_low <= t <= i.total_high
            for i, t in zip(found.kpi, TOTAL, strict=True)
        ]
    return (
        f"{sampler:12} {cases:5} cases, of {seeds}: first {first.tolist()} total {total.tolist()}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200)
    given = parser.parse_args()
    for sampler, cases, generation in SEARCHES:
        print(line(sampler, cases, generation, given.seeds), flush=True)


if __name__ == "__main__":
    main()
