"""95 % intervals of probabilities."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import stdtrit

from conductor.search.protocol import Array

Z = 1.959963984540054
"""Quantile of the normal distribution at 97.5 %."""


def wilson(hits: int, total: int) -> tuple[float, float]:
    """Interval of a share, by Wilson's score (Journal of the American Statistical Association 22,
    1927)."""
    share, square = hits / total, Z * Z
    middle = (share + square / (2 * total)) / (1 + square / total)
    spread = share * (1 - share) / total + square / (4 * total * total)
    half = Z * math.sqrt(spread) / (1 + square / total)
    return (max(0.0, middle - half) if hits else 0.0), min(1.0, middle + half)


def of_means(means: Array) -> tuple[float, float]:
    """Interval of the mean of independent estimates, by Student's distribution."""
    count = len(means)
    mean = float(np.mean(means))
    half = float(stdtrit(count - 1, 0.975)) * float(np.std(means, ddof=1)) / math.sqrt(count)
    return max(0.0, mean - half), min(1.0, mean + half)


def weighted(probability: float, shares: Array, total: int) -> tuple[float, float]:
    """Interval of an estimate that is the sum of independent parts, some large and most none.

    Taken as lognormal, since such estimates are positive and skewed. The squares of the parts'
    shares give the relative error; the inverse of their sum is Kish's effective number of parts
    (Survey Sampling, 1965), and one less the degrees of freedom of Student's quantile: an error
    that a few parts give is itself uncertain.

    Args:
        probability: the estimate, above 0.
        shares: of each part in it; their sum is 1.
        total: number of parts, those of no share among them.

    """
    square = float(np.sum(shares * shares))
    freedom = max(1.0, 1.0 / square - 1.0)
    relative = math.sqrt(max(0.0, square - 1.0 / total))
    return lognormal(probability, relative, float(stdtrit(freedom, 0.975)))


def lognormal(probability: float, relative: float, quantile: float = Z) -> tuple[float, float]:
    """Interval of an estimate with a relative standard error, taken as lognormal: such estimates
    are positive and skewed."""
    half = quantile * math.sqrt(math.log1p(relative * relative))
    return probability * math.exp(-half), min(1.0, probability * math.exp(half))


def of_logarithms(estimates: Array) -> tuple[float, float]:
    """Interval of the mean of independent estimates that are positive and skewed: lognormal, with
    the relative error of the mean by Student's distribution."""
    count, mean = len(estimates), float(np.mean(estimates))
    relative = float(np.std(estimates, ddof=1)) / math.sqrt(count) / mean
    return lognormal(mean, relative, float(stdtrit(count - 1, 0.975)))


def relative_error(probability: float, low: float | None) -> float:
    """The relative standard error of which :func:`lognormal` made an interval that begins at
    ``low``; 0 where there is none.

    The lower end, since the upper one is cut at 1.
    """
    if not probability > 0.0 or low is None or not 0.0 < low < probability:
        return 0.0
    sigma = math.log(probability / low) / Z
    return math.sqrt(math.expm1(sigma * sigma))
