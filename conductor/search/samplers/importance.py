"""Cross-entropy importance sampling: a density is moved to where cases fail, then sampled.

Rubinstein and Kroese, The Cross-Entropy Method (2004); mixtures of normal densities: Kurtz and
Song, Structural Safety 42 (2013).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from conductor.search.intervals import weighted
from conductor.search.protocol import Array, Estimate, History, Problem, Streams
from schemas.kinds.sampler import ImportanceOptions

STANDARD_SHARE = 0.05
"""Share of the standard normal density in every mixture: no weight is larger than its inverse."""
ROUND_SHARE = 0.15
"""Share of a normal density around the origin that reaches as far as the failures do, in all
directions: a failure that the modes miss weighs little more than the others."""
WIDENED = 1.3
"""Factor of the covariances of a mixture."""
ROUNDS = 20
"""Steps of the fit of a mixture."""
UNEVEN = 0.25
"""Relative error above which the weights say nothing: what was missed may weigh more."""
FITTED = 2
"""Fits to failures, one after the other, before the density stands."""
ADAPTED_MAX = 20
"""Most generations that the density is moved by."""


@dataclass(frozen=True, slots=True)
class Mixture:
    """Normal densities with weights, the standard one among them."""

    weights: Array
    """[modes]"""
    means: Array
    """[modes, parameters]"""
    roots: Array
    """Lower Cholesky factors of the covariances [modes, parameters, parameters]."""

    def draw(self, count: int, stream: np.random.Generator) -> Array:
        """Points [count, parameters]."""
        edges = np.cumsum(self.weights)
        modes = np.searchsorted(edges / edges[-1], stream.random(count), side="right")
        modes = np.minimum(modes, len(self.weights) - 1)
        z = stream.standard_normal((count, self.means.shape[1]))
        return np.asarray(self.means[modes] + np.einsum("nij,nj->ni", self.roots[modes], z))

    def log_parts(self, u: Array) -> Array:
        """Logarithms of weight times density of each mode [modes, points]."""
        back = np.linalg.inv(self.roots)
        z = np.matmul(u[None] - self.means[:, None], np.swapaxes(back, 1, 2))
        heights = np.log(self.weights) + np.sum(np.log(np.diagonal(back, axis1=1, axis2=2)), axis=1)
        return np.asarray(heights[:, None] - 0.5 * np.sum(z * z, axis=2))

    def ratios(self, u: Array) -> Array:
        """The standard normal density over this one [points]."""
        return np.asarray(np.exp(-0.5 * np.sum(u * u, axis=1) - _log_sum(self.log_parts(u))))


def standard(dimension: int) -> Mixture:
    """The standard normal density."""
    return Mixture(np.ones(1), np.zeros((1, dimension)), np.eye(dimension)[None])


class _Move(NamedTuple):
    """What followed from a generation."""

    density: Mixture
    """Density of the next one."""
    fitted: int
    """How often in a row it was fitted to failures."""


class Importance:
    """Moves its density until cases fail, fits it to failures twice, and samples it then."""

    def __init__(self, options: ImportanceOptions, problem: Problem) -> None:
        self._options, self._problem = options, problem
        self._moves: list[tuple[Array, _Move]] = []
        """Each generation that was looked at and what followed: a step asks twice."""

    def propose(self, history: History, streams: Streams) -> Array:
        """Points of the density as it is."""
        count = min(self._problem.generation, self._problem.cases - history.cases)
        density, _ = self._adapted(history)
        if count < 1:
            return np.zeros((0, self._problem.dimension))
        return density.draw(count, streams(f"generation {len(history.g)}"))

    def answer(self, history: History) -> Estimate:
        """The weighted share of failures among points of the final density."""
        density, begin = self._adapted(history)
        method = f"importance sampling by cross-entropy, {len(density.weights)} modes"
        if begin is None or begin >= len(history.g):
            return Estimate(method=f"{method}; the density still moves")
        u, g = np.concatenate(history.u[begin:]), np.concatenate(history.g[begin:])
        weights = np.where(g < 0, density.ratios(u), 0.0)
        mean = float(np.mean(weights))
        method = f"{method}; lognormal interval of {len(g)} weighted cases"
        if mean <= 0.0 or np.count_nonzero(weights) < 2:
            return Estimate(method=f"{method}; too few failures")
        shares = weights / np.sum(weights)
        if float(np.sum(shares * shares)) > UNEVEN * UNEVEN:
            return Estimate(method=f"{method}; few of them have nearly all the weight")
        low, high = weighted(mean, shares, len(g))
        return Estimate(method=method, probability=mean, low=low, high=high)

    def _adapted(self, history: History) -> tuple[Mixture, int | None]:
        """The density of the next generation, and the first generation that is of it; None: it may
        still move."""
        move = _Move(standard(self._problem.dimension), 0)
        drawn_of = list[Mixture]()
        for index, u in enumerate(history.u):
            if move.fitted == FITTED or index >= ADAPTED_MAX:
                return move.density, index
            drawn_of.append(move.density)
            if index >= len(self._moves) or self._moves[index][0] is not u:
                self._moves[index:] = [(u, self._moved(history, drawn_of, move.fitted))]
            move = self._moves[index][1]
        return move.density, len(history.g) if move.fitted == FITTED else None

    def _moved(self, history: History, drawn_of: list[Mixture], fitted: int) -> _Move:
        """The density that follows from the generations that were drawn of these: all their points
        count, so a place that an earlier one has found is not lost by chance."""
        latest = history.g[len(drawn_of) - 1]
        place = max(1, round(self._options.share * len(latest))) - 1
        level = float(np.sort(latest)[place])
        failing = level < 0
        u = np.concatenate(history.u[: len(drawn_of)])
        g = np.concatenate(history.g[: len(drawn_of)])
        u = u[(g < 0) if failing else (g <= level)]
        sizes = [len(part) for part in history.g[: len(drawn_of)]]
        mixed = [
            math.log(size / len(g)) + _log_sum(density.log_parts(u))
            for size, density in zip(sizes, drawn_of, strict=True)
        ]
        ratios = np.exp(-0.5 * np.sum(u * u, axis=1) - _log_sum(np.array(mixed)))
        return _Move(_fit(u, ratios, self._options.modes), fitted + 1 if failing else 0)


def _fit(u: Array, ratios: Array, modes: int) -> Mixture:
    """A mixture that is fitted to weighted points by expectation maximisation, with the densities
    that :data:`STANDARD_SHARE` and :data:`ROUND_SHARE` stand for."""
    count, dimension = u.shape
    if not float(np.sum(ratios)) > 0.0:
        ratios = np.ones(count)
    shares = ratios / np.sum(ratios)
    modes = max(1, min(modes, count // (3 * dimension)))
    means = u[_apart(u, modes)]
    distance = np.sum((u[None] - means[:, None]) ** 2, axis=2)
    belongs = (np.argmin(distance, axis=0)[None] == np.arange(modes)[:, None]).astype(np.float64)
    mixture = _moments(u, shares, belongs)
    for _ in range(ROUNDS):
        parts = mixture.log_parts(u)
        mixture = _moments(u, shares, np.exp(parts - _log_sum(parts)))
    even = max(1.0, float(shares @ np.sum(u * u, axis=1)) / dimension)
    rest = 1 - STANDARD_SHARE - ROUND_SHARE
    return Mixture(
        np.concatenate([rest * mixture.weights, [ROUND_SHARE, STANDARD_SHARE]]),
        np.concatenate([mixture.means, np.zeros((2, dimension))]),
        np.concatenate([mixture.roots, [math.sqrt(even) * np.eye(dimension), np.eye(dimension)]]),
    )


def _moments(u: Array, shares: Array, belongs: Array) -> Mixture:
    """Means and covariances of points that belong to modes by shares; covariances are widened, and
    those of few points drawn towards a multiple of the identity: what is too narrow misses
    failures, which then weigh much and come rarely."""
    dimension = u.shape[1]
    weights = shares * belongs
    totals = np.sum(weights, axis=1)
    some = totals >= 1e-6
    totals, weights = totals[some], weights[some] / totals[some][:, None]
    means = weights @ u
    apart = u[None] - means[:, None]
    covariances = np.matmul(np.swapaxes(weights[:, :, None] * apart, 1, 2), apart)
    effective = 1.0 / np.sum(weights * weights, axis=1)
    unknowns = dimension * (dimension + 1) / 2
    pull = (unknowns / (unknowns + effective))[:, None, None]
    even = np.maximum(1.0, np.trace(covariances, axis1=1, axis2=2) / dimension)[:, None, None]
    covariances = (1 - pull) * WIDENED * covariances + pull * even * np.eye(dimension)
    return Mixture(totals / np.sum(totals), means, np.linalg.cholesky(covariances))


def _apart(u: Array, count: int) -> list[int]:
    """Indices of points that are far from each other, the one nearest to the origin first."""
    chosen = [int(np.argmin(np.sum(u * u, axis=1)))]
    nearest = np.sum((u - u[chosen[0]]) ** 2, axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.sum((u - u[chosen[-1]]) ** 2, axis=1))
    return chosen


def _log_sum(parts: Array) -> Array:
    """Logarithm of the sum of exponentials over modes [points]."""
    top = np.max(parts, axis=0)
    return np.asarray(top + np.log(np.sum(np.exp(parts - top), axis=0)))
