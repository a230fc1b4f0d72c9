"""Saltelli's design: the cases from which Sobol indices of first and of total order are taken.

Two matrices A and B of independent points, and for every parameter A with that column of B:
d + 2 cases for each row (Saltelli et al., Computer Physics Communications 181, 2010). Each
generation has a block of a power of two rows, the points of a Sobol sequence that is scrambled
anew: of one long sequence the resamples' intervals covered weak parameters in 89 of 100 seeds.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from scipy.stats import qmc

from conductor.search.intervals import wilson
from conductor.search.protocol import Array, Estimate, History, Problem, Streams
from conductor.search.samplers.spread_points import normal, spawning


class Saltelli:
    """Blocks of rows of the design; each block is A, B, and A with each column of B in turn."""

    def __init__(self, _options: Struct, problem: Problem) -> None:
        self.problem = problem
        self.rows = rows_of(problem.dimension, min(problem.generation, problem.cases))
        """Rows of a block."""

    def propose(self, history: History, streams: Streams) -> Array:
        """The next block, if the budget has room for it."""
        dimension, rows = self.problem.dimension, self.rows
        if not rows or history.cases + rows * (dimension + 2) > self.problem.cases:
            return np.zeros((0, dimension))
        stream = spawning(streams(f"generation {len(history.g)}"))
        points = normal(qmc.Sobol(2 * dimension, rng=stream).random(rows))
        a, b = points[:, :dimension], points[:, dimension:]
        parts = [a, b]
        for column in range(dimension):
            mixed = a.copy()
            mixed[:, column] = b[:, column]
            parts.append(mixed)
        return np.concatenate(parts)

    def answer(self, history: History) -> Estimate:
        """The share of failures of A and B, whose points follow the distributions."""
        independent = np.concatenate([part[: 2 * self.rows] for part in history.g])
        hits = int(np.count_nonzero(independent < 0))
        low, high = wilson(hits, len(independent))
        return Estimate(
            method=f"the {len(independent)} independent cases of Saltelli's design; "
            "Wilson's interval",
            probability=hits / len(independent),
            low=low,
            high=high,
        )


def rows_of(dimension: int, cases: int) -> int:
    """Rows of the design for which so many cases are enough: a power of two, or 0."""
    rows = cases // (dimension + 2)
    return 1 << (rows.bit_length() - 1) if rows else 0
