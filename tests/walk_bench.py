"""Searches on random walks: chance alone decides, case by case, and the probability is known.

A walk goes one step up or down at every tick; it fails if it ever reaches a height. Its numbers are
keyed by name as those of cases are, so a fork of a walk is what a fork of a case is.

``python tests/walk_bench.py --seeds 200`` says how often intervals of splitting cover the truth.
"""

from __future__ import annotations

import argparse
import math
from functools import cache
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET

from conductor.search.driver import Closed, Proposal, first, follow
from schemas.files.search_result import SearchAnswer
from schemas.identity import stream_key
from schemas.searching.search_points import lineage, with_forks
from schemas.sections.fork import Fork
from schemas.sections.search import Search, name_of

TICKS = 64
LIMIT = 0.5
SHIFTS = 4
"""Furthest that a walk with a parameter begins from 0, up or down."""


def walk_section(cases: int, *, shifted: bool = False, **changes: Any) -> Search:
    """The section of a search on walks; ``shifted``: with the start as its one parameter."""
    start = {"distribution": "integers", "low": -SHIFTS, "high": SHIFTS}
    section = {
        "parameters": {"objects.a.offset_m": start} if shifted else {},
        "objective": {"kpi": "dtc_min_m", "fails_below": LIMIT},
        "budget": {"cases": cases},
        "sampler": "splitting",
        **changes,
    }
    return msgspec.convert(section, Search)


def walked(seed: int, name: str, forks: list[Fork], start: int, height: int) -> float:
    """Smallest distance of a walk from the height."""
    steps = _steps(seed, forks[0].case if forks else name)
    coming, at, least = forks[1:], start, math.inf
    for tick in range(TICKS + 1):
        distance = float(height - at)
        least = min(least, distance)
        while coming and least - LIMIT < coming[0].margin:
            steps = _steps(seed, coming[0].case)
            coming = coming[1:]
        if tick < TICKS:
            at += steps[tick]
    return least


def truth(height: int, *, shifted: bool = False) -> float:
    """Probability that a walk reaches the height, by reflection."""
    starts = range(-SHIFTS, SHIFTS + 1) if shifted else [0]
    return sum(_reaches(height - start) for start in starts) / len(starts)


def solve_walks(search: Search, seed: int, height: int) -> tuple[SearchAnswer, Search]:
    """The answer of a search, and the section with all that was proposed."""
    proposal: Proposal | None = first(search, "walk", seed)
    u: list[list[list[float]]] = []
    results: list[list[float | None]] = []
    while True:
        assert proposal is not None
        number = len(u)
        u.append(proposal.u)
        search = msgspec.structs.replace(search, proposed=[*search.proposed, proposal.values])
        if proposal.forks:
            search = msgspec.structs.replace(
                search, forks=with_forks(search, number, proposal.forks)
            )
        kpis: list[float | None] = []
        for index, values in enumerate(proposal.values):
            name = name_of(number, index)
            forks = lineage(search, name)
            start = int(values[0]) if values else 0
            kpis.append(walked(seed, name, [] if forks is UNSET else forks, start, height))
        results.append(kpis)
        step = follow(search, "walk", seed, Closed(u, results))
        if step.ended:
            return step.answer, search
        proposal = step.proposal


@cache
def _steps(seed: int, name: str) -> list[int]:
    key = stream_key(seed, name, "steps")
    stream = np.random.Generator(np.random.Philox(key=[key, 0]))
    steps: list[int] = (2 * stream.integers(0, 2, TICKS) - 1).tolist()
    return steps


def _reaches(height: int) -> float:
    ways = [(2 * up - TICKS, math.comb(TICKS, up)) for up in range(TICKS + 1)]
    beyond = sum(count for end, count in ways if end > height)
    there = sum(count for end, count in ways if end == height)
    return (2 * beyond + there) / 2.0**TICKS if height > 0 else 1.0


def main() -> None:
    """Print coverage, mean and error over seeds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--particles", type=int, default=50)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--share", type=float, default=0.5)
    asked = parser.parse_args()
    options = {"particles": asked.particles, "runs": asked.runs, "share": asked.share}
    for height, shifted in ((16, False), (26, False), (32, False), (30, True)):
        search = walk_section(10_000, shifted=shifted, options=options)
        p, covered, cases = truth(height, shifted=shifted), 0, 0
        found = []
        for seed in range(asked.seeds):
            answer, _ = solve_walks(search, seed, height)
            _steps.cache_clear()
            assert answer.probability is not None, answer.method
            assert answer.low is not None
            assert answer.high is not None
            covered += answer.low <= p <= answer.high
            cases += answer.cases
            found.append(answer.probability / p)
        spread, cases = float(np.std(found)), cases // asked.seeds
        gain = (1 - p) / p / spread**2 / cases
        print(
            f"height {height}{' shifted' if shifted else ''}: p {p:.3g}, covers {covered} of "
            f"{asked.seeds}, mean over truth {np.mean(found):.3f}, relative error {spread:.3f}, "
            f"cases {cases}, gain {gain:.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
