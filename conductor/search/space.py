"""From standard normal coordinates to values of parameters: a Gaussian copula."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri

from conductor.search.protocol import Array
from schemas.searching.search_points import Z_MAX, correlation_factor
from schemas.sections.search import (
    Choices,
    Distribution,
    Exponential,
    Integers,
    LogNormal,
    Normal,
    Search,
    Triangular,
    TruncatedNormal,
    Uniform,
    Value,
)

DIGITS = 9
"""Significant digits of a value: the last bits of the library's functions differ between hosts."""


def values_of(search: Search, u: Array) -> list[list[Value]]:
    """Values of the parameters [cases][parameters] at coordinates ``u`` [cases, parameters]."""
    z = normals_of(search, u)
    columns = [column_of(d, z[:, i]) for i, d in enumerate(search.parameters.values())]
    return [[column[case] for column in columns] for case in range(len(u))]


def normals_of(search: Search, u: Array) -> Array:
    """The normal variable behind each parameter [cases, parameters]: with their correlations."""
    z = np.zeros_like(u)
    for i, row in enumerate(correlation_factor(search)):
        for j, weight in enumerate(row[: i + 1]):  # not a product of matrices: in a fixed order
            z[:, i] += weight * u[:, j]
    return np.asarray(np.clip(z, -Z_MAX, Z_MAX))


def column_of(distribution: Distribution, z: Array) -> list[Value]:
    """Values of one parameter at its normal variable ``z``; they ascend with it, except for
    choices."""
    match distribution:
        case Choices():
            weights = distribution.weights or [1.0] * len(distribution.values)
            edges = np.cumsum(weights) / sum(weights)
            places = np.searchsorted(edges, ndtr(z), side="right")
            return [distribution.values[min(int(p), len(weights) - 1)] for p in places]
        case Integers():
            count = distribution.high - distribution.low + 1
            steps = np.minimum(np.floor(ndtr(z) * count), count - 1)
            return [distribution.low + int(step) for step in steps]
        case _:
            numbers = _CONTINUOUS[type(distribution)](distribution, z)
            if distribution.whole:
                return [round(float(number)) for number in numbers]
            return [float(f"{number:.{DIGITS}g}") for number in numbers]


def _uniform(d: Uniform, z: Array) -> Array:
    return np.asarray(np.clip(d.low + (d.high - d.low) * ndtr(z), d.low, d.high))


def _normal(d: Normal, z: Array) -> Array:
    return np.asarray(d.mean + d.sd * z)


def _truncated(d: TruncatedNormal, z: Array) -> Array:
    low, high = (d.low - d.mean) / d.sd, (d.high - d.mean) / d.sd
    # In the tail that is nearer, where differences of shares keep their digits.
    sign = -1.0 if low > 0 else 1.0
    ends = (-high, -low) if low > 0 else (low, high)
    below, above = ndtr(ends[0]), ndtr(ends[1])
    cut = sign * ndtri(below + (above - below) * ndtr(sign * z))
    return np.asarray(np.clip(d.mean + d.sd * cut, d.low, d.high))


def _lognormal(d: LogNormal, z: Array) -> Array:
    return np.asarray(d.median * np.exp(d.sigma * z))


def _exponential(d: Exponential, z: Array) -> Array:
    return np.asarray(d.low - d.mean * log_ndtr(-z))


def _triangular(d: Triangular, z: Array) -> Array:
    share, width = ndtr(z), d.high - d.low
    rise = (d.mode - d.low) / width
    up = d.low + np.sqrt(share * width * (d.mode - d.low))
    down = d.high - np.sqrt(ndtr(-z) * width * (d.high - d.mode))
    return np.asarray(np.where(share < rise, up, down))


_CONTINUOUS: dict[type, Callable[..., Array]] = {
    Uniform: _uniform,
    Normal: _normal,
    TruncatedNormal: _truncated,
    LogNormal: _lognormal,
    Exponential: _exponential,
    Triangular: _triangular,
}
