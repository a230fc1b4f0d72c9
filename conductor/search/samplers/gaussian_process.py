"""A Gaussian process over margins: what is likely between the cases that have run.

Rasmussen and Williams, Gaussian Processes for Machine Learning (2006). Places are shares: the
standard normal coordinates through the normal distribution, so each parameter goes from 0 to 1.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_triangular
from scipy.optimize import minimize
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

from conductor.search.protocol import Array

LENGTHS = (0.03, 10.0)
"""Shortest and longest distance over which margins are alike, in shares."""
NOISES = (1e-6, 0.3)
"""Least and most variance of what is not explained by the place; margins have variance 1."""
STEPS_MAX = 60
"""Most steps of the fit of distances and noise."""
FITTED_MAX = 250
"""Most cases to which distances and noise are fitted; all cases count for what is likely then."""
SPREAD_MAX = 4.0
"""Margins that are further above the median than so many times its distance from the least are
taken for that far: how well a case went says little about where the worst are."""


@dataclass(slots=True)
class Candidates:
    """Places where a case could run, and what is likely there."""

    places: Array
    """Shares [candidates, parameters]."""
    mean: Array
    """Likely margins, scaled [candidates]."""
    variance: Array
    """Their variances [candidates]."""
    rows: Array
    """Rows of the triangular solve that variances follow from [cases, candidates]."""


class Surrogate:
    """A Gaussian process that was fitted to cases."""

    def __init__(self, places: Array, margins: Array) -> None:
        """A fit.

        Args:
            places: shares [cases, parameters].
            margins: [cases].
        """
        self.offset, self.scale = 0.0, 1.0
        scaled = self._scaled(margins)
        dimension = places.shape[1]
        kernel = ConstantKernel(1.0, (0.05, 50.0)) * Matern(
            np.full(dimension, 0.3), LENGTHS, nu=2.5
        ) + WhiteKernel(1e-3, NOISES)
        chosen = _spread_over(scaled)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of fits that end at a limit
            fitted = GaussianProcessRegressor(kernel, alpha=1e-8, optimizer=_fit)
            kernel = fitted.fit(places[chosen], scaled[chosen]).kernel_
            self._process = GaussianProcessRegressor(kernel, alpha=1e-8, optimizer=None)
            self._process.fit(places, scaled)
        self.places = places
        self.kernel = kernel.k1
        """Without noise: a case that would be run again would have the same margin."""
        self.noise = float(kernel.k2.noise_level)
        self.least = float(np.min(scaled))
        """Least of the scaled margins."""

    def at(self, places: Array) -> Candidates:
        """What is likely at places [candidates, parameters]."""
        between = self.kernel(self.places, places)
        mean = between.T @ self._process.alpha_
        rows = solve_triangular(self._process.L_, between, lower=True)
        variance = self.kernel.diag(places) - np.sum(rows * rows, axis=0)
        return Candidates(places, mean, np.maximum(variance, 0.0), rows)

    def believe(self, candidates: Candidates, index: int) -> None:
        """Take the likely margin of a candidate for a case that has run (the kriging believer of
        Ginsbourger, Le Riche and Carraro, 2010): means stay, variances near it shrink."""
        place = candidates.places[index : index + 1]
        between = self.kernel(place, candidates.places)[0]
        between = between - candidates.rows[:, index] @ candidates.rows
        row = between / np.sqrt(candidates.variance[index] + self.noise + 1e-8)
        candidates.rows = np.vstack([candidates.rows, row])
        candidates.variance = np.maximum(candidates.variance - row * row, 0.0)

    def scaled(self, margin: float) -> float:
        """A margin on the scale of the process."""
        return (margin - self.offset) / self.scale

    def _scaled(self, margins: Array) -> Array:
        """Margins with mean 0 and variance 1."""
        least, middle = float(np.min(margins)), float(np.median(margins))
        if middle > least:
            margins = np.minimum(margins, middle + SPREAD_MAX * (middle - least))
        self.offset = float(np.mean(margins))
        self.scale = float(np.std(margins)) or 1.0
        return np.asarray((margins - self.offset) / self.scale)


def _spread_over(scaled: Array) -> npt.NDArray[np.int64]:
    """The cases to which a process is fitted: the worst half, and others over the whole range."""
    if len(scaled) <= FITTED_MAX:
        return np.arange(len(scaled))
    order = np.argsort(scaled, kind="stable")
    worst, others = order[: FITTED_MAX // 2], order[FITTED_MAX // 2 :]
    steps = np.linspace(0, len(others) - 1, FITTED_MAX - len(worst)).round().astype(np.int64)
    return np.sort(np.concatenate([worst, others[steps]]))


def _fit(objective: Any, start: Array, bounds: Array) -> tuple[Array, float]:
    """The parameters with the greatest likelihood, from one start."""
    found = minimize(
        objective,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": STEPS_MAX},
    )
    return found.x, float(found.fun)
