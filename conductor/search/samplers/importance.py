"""Cross-entropy importance sampling: a density is moved to where cases fail, then sampled.

Rubinstein and Kroese, The Cross-Entropy Method (2004); mixtures of normal densities: Kurtz and
Song, Structural Safety 42 (2013).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from conductor.search.intervals import lognormal
from conductor.search.protocol import Array, Estimate, History, Problem, Streams
from schemas.kinds.sampler import ImportanceOptions

STANDARD_SHARE = 0.1
"""Share of the standard normal density in every mixture: no weight is larger than its inverse."""
WIDENED = 1.3
"""Factor of the covariances of a mixture."""
ROUNDS = 20
"""Steps of the fit of a mixture."""
UNEVEN = 0.25
"""Relative error above which the weights say nothing: what was missed may weigh more."""
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
        rows = []
        for weight, mean, root in zip(self.weights, self.means, self.roots, strict=True):
            z = np.linalg.solve(root, (u - mean).T)
            log_root = float(np.sum(np.log(np.diag(root))))
            rows.append(math.log(weight) - log_root - 0.5 * np.sum(z * z, axis=0))
        return np.array(rows)

    def ratios(self, u: Array) -> Array:
        """The standard normal density over this one [points]."""
        return np.asarray(np.exp(-0.5 * np.sum(u * u, axis=1) - _log_sum(self.log_parts(u))))


def standard(dimension: int) -> Mixture:
    """The standard normal density."""
    return Mixture(np.ones(1), np.zeros((1, dimension)), np.eye(dimension)[None])


class Importance:
    """Moves its density until cases fail, fits it to failures twice, and samples it then."""

    def __init__(self, options: ImportanceOptions, problem: Problem) -> None:
        self._options, self._problem = options, problem

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
        relative = float(np.std(weights, ddof=1)) / math.sqrt(len(g)) / mean
        if relative > UNEVEN:
            return Estimate(method=f"{method}; few of them have nearly all the weight")
        low, high = lognormal(mean, relative)
        return Estimate(method=method, probability=mean, low=low, high=high)

    def _adapted(self, history: History) -> tuple[Mixture, int | None]:
        """The density of the next generation, and the first generation that is of it; None: it may
        still move."""
        density, fitted = standard(self._problem.dimension), 0
        for index, (u, g) in enumerate(zip(history.u, history.g, strict=True)):
            if fitted == 2 or index >= ADAPTED_MAX:
                return density, index
            place = max(1, round(self._options.share * len(g))) - 1
            level = float(np.sort(g)[place])
            failing = level < 0
            inside = (g < 0) if failing else (g <= level)
            fitted = fitted + 1 if failing else 0
            density = _fit(u[inside], density.ratios(u[inside]), self._options.modes)
        return density, len(history.g) if fitted == 2 else None


def _fit(u: Array, ratios: Array, modes: int) -> Mixture:
    """A mixture that is fitted to weighted points by expectation maximisation."""
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
        parts = mixture.log_parts(u)[:-1]  # the last mode is the standard density
        belongs = np.exp(parts - _log_sum(parts))
        mixture = _moments(u, shares, belongs)
    return mixture


def _moments(u: Array, shares: Array, belongs: Array) -> Mixture:
    """Means and covariances of points that belong to modes by shares; covariances are widened, and
    those of few points drawn towards a multiple of the identity: what is too narrow misses
    failures, which then weigh much and come rarely."""
    dimension = u.shape[1]
    weights, means, roots = [], [], []
    for mode in belongs:
        weight = shares * mode
        total = float(np.sum(weight))
        if total < 1e-6:
            continue
        weight = weight / total
        mean = weight @ u
        apart = u - mean
        covariance = (weight[:, None] * apart).T @ apart
        effective = 1.0 / float(np.sum(weight * weight))
        unknowns = dimension * (dimension + 1) / 2
        pull = unknowns / (unknowns + effective)
        even = max(1.0, float(np.trace(covariance)) / dimension)
        covariance = (1 - pull) * WIDENED * covariance + pull * even * np.eye(dimension)
        roots.append(np.linalg.cholesky(covariance))
        weights.append(total)
        means.append(mean)
    scaled = (1 - STANDARD_SHARE) * np.array(weights) / sum(weights)
    return Mixture(
        np.append(scaled, STANDARD_SHARE),
        np.vstack([*means, np.zeros(dimension)]),
        np.concatenate([np.array(roots), np.eye(dimension)[None]]),
    )


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
