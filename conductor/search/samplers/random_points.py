"""Independent points."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from conductor.search.intervals import wilson
from conductor.search.protocol import Array, Estimate, History, Problem, Streams


class MonteCarlo:
    """Independent points; the share of failures, with Wilson's interval."""

    def __init__(self, _options: Struct, problem: Problem) -> None:
        self.problem = problem

    def propose(self, history: History, streams: Streams) -> Array:
        """Generations of equal size; the last one takes what the budget leaves."""
        count = min(self.problem.generation, self.problem.cases - history.cases)
        return self.points(count, streams(f"generation {len(history.g)}"))

    def answer(self, history: History) -> Estimate:
        """The share of failures."""
        g = np.concatenate(history.g)
        hits = int(np.count_nonzero(g < 0))
        low, high = wilson(hits, len(g))
        method = "Monte Carlo; Wilson's interval"
        return Estimate(method=method, probability=hits / len(g), low=low, high=high)

    def points(self, count: int, stream: np.random.Generator) -> Array:
        """Coordinates of further points [count, parameters]."""
        count = max(0, count)
        return stream.standard_normal((count, self.problem.dimension))
