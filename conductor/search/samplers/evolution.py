"""CMA-ES: a normal distribution of cases that moves to where the objective is worse."""

from __future__ import annotations

from typing import Any

import cma
import numpy as np

from conductor.search.protocol import Array, Estimate, History, Problem, Streams
from schemas.kinds.sampler import CmaOptions

RESTART_SD = 2.0
"""Spread of the places from which it starts again."""


class CmaEs:
    """Hansen's evolution strategy (Evolutionary Computation 9, 2001), of the package ``cma``.

    A strategy that has converged starts again somewhere else. It is rebuilt of the history at every
    generation, so a search that was interrupted goes on as if it had not been.
    """

    def __init__(self, options: CmaOptions, problem: Problem) -> None:
        self._options, self._problem = options, problem

    def propose(self, history: History, streams: Streams) -> Array:
        """The next population."""
        dimension = self._problem.dimension
        count = self._problem.generation
        if self._problem.cases - history.cases < count:
            return np.zeros((0, dimension))
        numbers = _Numbers()
        start = np.zeros(dimension)
        if self._problem.chain:
            start = RESTART_SD * streams("start").standard_normal(dimension)
        strategy = self._begun(start, numbers)
        for index, (u, g) in enumerate(zip(history.u, history.g, strict=True)):
            numbers.stream = streams(f"generation {index}")
            strategy.ask()  # as it was asked then; what was proposed then is what it is told
            strategy.tell(list(u), list(g), check_points=False)
            if strategy.stop():
                start = streams(f"restart {index}").standard_normal(dimension)
                strategy = self._begun(RESTART_SD * start, numbers)
        numbers.stream = streams(f"generation {len(history.g)}")
        return np.array(strategy.ask(), np.float64)

    def answer(self, _history: History) -> Estimate:
        """No probability: its points are where it is bad."""
        return Estimate(method="CMA-ES; an extreme, no probability")

    def _begun(self, start: Array, numbers: _Numbers) -> Any:
        options = {
            "popsize": self._problem.generation,
            "randn": numbers.normal,
            "seed": np.nan,  # else it would seed NumPy's global numbers
            "verbose": -9,
            "verb_log": 0,
            "CMA_diagonal": 0,
        }
        return cma.CMAEvolutionStrategy(start, self._options.sigma, options)


class _Numbers:
    """Random numbers for the strategy, of a stream that changes with the generation."""

    def __init__(self) -> None:
        self.stream = np.random.Generator(np.random.Philox(0))

    def normal(self, *shape: int) -> Array:
        """Standard normal numbers."""
        return np.asarray(self.stream.standard_normal(shape), np.float64)
