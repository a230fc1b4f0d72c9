"""Points that are spread evenly: Latin hypercubes and scrambled Sobol points.

A module of its own, because it takes a second to load what spreads them.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc

from conductor.search.intervals import of_means, wilson
from conductor.search.protocol import Array, Estimate, History
from conductor.search.samplers.random_points import MonteCarlo

GENERATIONS_MIN = 8
"""Fewest generations whose means give an interval of their own."""
FAILURES_MIN = 10
"""Fewest failures in them."""


class _Spread(MonteCarlo):
    """Generations that are spread evenly, each randomised anew: their means are independent."""

    _title: str

    def answer(self, history: History) -> Estimate:
        """The mean over generations; few of them, or few failures, have Wilson's interval, which is
        too wide rather than too narrow for points that are spread."""
        g = np.concatenate(history.g)
        hits = int(np.count_nonzero(g < 0))
        size = len(history.g[0])
        whole = np.array([np.mean(part < 0) for part in history.g if len(part) == size])
        if len(whole) >= GENERATIONS_MIN and hits >= FAILURES_MIN:
            low, high = of_means(whole)
            method = f"{self._title}; Student's interval of the means of {len(whole)} generations"
            return Estimate(method=method, probability=float(np.mean(whole)), low=low, high=high)
        low, high = wilson(hits, len(g))
        method = f"{self._title}; Wilson's interval"
        return Estimate(method=method, probability=hits / len(g), low=low, high=high)


class LatinHypercube(_Spread):
    """Points of a Latin hypercube: one in every slice of every parameter, per generation."""

    _title = "Latin hypercube"

    def points(self, count: int, stream: np.random.Generator) -> Array:
        """Coordinates of further points [count, parameters]."""
        if count < 1:
            return np.zeros((0, self.problem.dimension))
        unit = qmc.LatinHypercube(self.problem.dimension, rng=spawning(stream)).random(count)
        return normal(unit)


class Sobol(_Spread):
    """Scrambled Sobol sequences, a power of two points per generation."""

    _title = "scrambled Sobol points"

    def points(self, count: int, stream: np.random.Generator) -> Array:
        """Coordinates of further points [count, parameters]."""
        if count < 1:
            return np.zeros((0, self.problem.dimension))
        exponent = count.bit_length() - 1
        unit = qmc.Sobol(self.problem.dimension, rng=spawning(stream)).random_base2(exponent)
        return normal(unit)


def normal(unit: Array) -> Array:
    """Points of the unit cube as standard normal coordinates; 0 and 1 have none."""
    return np.asarray(ndtri(np.clip(unit, 1e-15, 1 - 1e-15)), np.float64)


def spawning(stream: np.random.Generator) -> np.random.Generator:
    """A generator that SciPy can make further ones of, which a keyed one has no seed for."""
    return np.random.default_rng(int(stream.integers(2**63)))
