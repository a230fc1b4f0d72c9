"""Threshold of the constant false-alarm rate: order statistics of sums over the array.

A cell's value is the mean power of its M antennas. Of noise alone it is a gamma variable of shape
M. A cell is reported if it exceeds ``factor`` times the k-th smallest of N reference cells
(OS-CFAR, Rohling 1983), so the level of the noise need not be known, and up to N - k cells with
targets among the references do no harm.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from schemas.steady import steady

REFERENCES = 32
"""Reference cells N: a quarter on each side, in range and in speed."""
RANK = 24
"""Which of them is the level: k, from the smallest, 1 to N."""
GUARD = 4
"""Cells on each side of a cell that are no reference, because its own signal reaches there."""

_GRID = 20_001


@cache
def factor(rate: float, antennas: int, references: int = REFERENCES, rank: int = RANK) -> float:
    """Factor that gives a false-alarm ``rate`` per cell [-].

    P(X > a Z_k) is the integral over z of the density of the k-th smallest of N gamma variables
    times the probability Q(M, a z) that another is above a z. For M = 1 it has the closed form
    prod_{i < k} (N - i) / (N - i + a).
    """
    low, high = 0.0, 200.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        if false_alarms(middle, antennas, references, rank) > rate:
            low = middle
        else:
            high = middle
    return float(f"{high:.10g}")


def false_alarms(
    above: float, antennas: int, references: int = REFERENCES, rank: int = RANK
) -> float:
    """Probability that noise alone exceeds ``above`` times the level [-]."""
    z, density = _level_density(antennas, references, rank)
    return float(np.trapezoid(density * np.exp(_log_above(above * z, antennas)), z))


@cache
def level_mean(antennas: int, references: int = REFERENCES, rank: int = RANK) -> float:
    """Mean of the k-th smallest reference over the mean of all noise [-]."""
    z, density = _level_density(antennas, references, rank)
    return float(f"{np.trapezoid(density * z, z) / antennas:.10g}")


POWER_ROWS = 1024
"""Rows of each half of :func:`power_table`, less one."""
POWER_END = 33.0 * math.log(2.0)
"""-ln of the least tail that a uniform number of 32 bits reaches."""


@cache
def power_table(antennas: int) -> np.ndarray:
    """Sum of ``antennas`` exponential variables by its tail's probability t, float32 [2 x rows].

    First below the median, then above; each at -ln t from ln 2 to :data:`POWER_END` in even steps.
    Rounded far above the error of the tails' logarithms, so the same everywhere.
    """
    z = np.linspace(0.0, antennas + 12.0 * math.sqrt(antennas) + 30.0, 10 * _GRID)[1:]
    log_above = _log_above(z, antennas)
    log_below = np.log(np.maximum(-np.expm1(log_above), 1e-300))
    tails = np.linspace(math.log(2.0), POWER_END, POWER_ROWS + 1)
    below = np.interp(tails, -log_below[::-1], z[::-1])
    above = np.interp(tails, -log_above, z)
    values = np.concatenate([below, above])
    return steady(values, 16).astype(np.float32)


@cache
def _level_density(antennas: int, references: int, rank: int) -> tuple[np.ndarray, np.ndarray]:
    """Density of the k-th smallest of N gamma variables of shape M, and where it stands."""
    z = np.linspace(0.0, antennas + 12.0 * math.sqrt(antennas) + 30.0, _GRID)[1:]
    log_above = _log_above(z, antennas)
    log_below = np.log(np.maximum(-np.expm1(log_above), 1e-300))
    log_density = (antennas - 1) * np.log(z) - z - math.lgamma(antennas)
    ways = math.lgamma(references + 1) - math.lgamma(rank) - math.lgamma(references - rank + 1)
    total = ways + (rank - 1) * log_below + (references - rank) * log_above + log_density
    return z, np.exp(total)


def _log_above(z: np.ndarray, antennas: int) -> np.ndarray:
    """Logarithm of Q(M, z) = e^-z sum_{i < M} z^i / i!."""
    log_z = np.log(np.maximum(z, 1e-300))
    terms = np.stack([i * log_z - math.lgamma(i + 1) for i in range(antennas)])
    peak = terms.max(axis=0)
    return np.asarray(peak + np.log(np.exp(terms - peak).sum(axis=0)) - z)
