"""Cells of a search's operational domain, their probabilities, and which cases lie in them."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
from msgspec import UNSET
from scipy.special import ndtr, ndtri

from conductor.search.answers.case_rows import SearchRows
from conductor.search.answers.coverage import Axis, coverage_of
from conductor.search.protocol import Array
from conductor.search.space import column_of
from schemas.files.search_result import SearchCoverage
from schemas.searching.search_points import Z_MAX, correlation_matrix
from schemas.sections.search import (
    CELLS_MAX,
    Choices,
    Distribution,
    DomainCells,
    Integers,
    Search,
    Triangular,
    TruncatedNormal,
    Uniform,
    Value,
)

BINS = 8
"""Cells of a parameter of which nothing is said."""
TAIL = 0.001
"""Probability beyond the outer cells of equal width, on each side, where a distribution has no
ends."""
_HALVINGS = 60
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(48)


def search_coverage(search: Search, rows: SearchRows) -> SearchCoverage:
    """Share of the domain that the cases of a search have tried."""
    domain = {} if search.domain is UNSET else search.domain
    axes, edges = [], []
    for place, (name, distribution) in enumerate(search.parameters.items()):
        column = rows.column(place)
        if isinstance(distribution, Choices):
            axis, z = _of_choices(name, distribution, column)
        else:
            axis, z = _of_numbers(name, distribution, domain.get(name), column)
        axes.append(axis)
        edges.append(z)
    matrix = correlation_matrix(search)
    together = {
        (i, j): _together(edges[i], edges[j], matrix[i][j])
        for i, j in combinations(range(len(axes)), 2)
        if matrix[i][j]
    }
    return coverage_of(axes, together)


def _of_choices(name: str, distribution: Choices, column: list[Value]) -> tuple[Axis, Array]:
    """A cell for each value; of many, the last one is for all others."""
    values, count = distribution.values, len(distribution.values)
    shares = np.array(distribution.weights or [1.0] * count, np.float64)
    edges = np.concatenate([[0.0], np.cumsum(shares) / np.sum(shares)])
    edges = np.concatenate([edges[: min(count, CELLS_MAX)], [1.0]])
    labels = [str(value) for value in values[: len(edges) - 1]]
    if count > CELLS_MAX:
        labels[-1] = f"{count - CELLS_MAX + 1} others"
    places = {repr(value): min(i, len(labels) - 1) for i, value in enumerate(values)}
    cells = np.array([places[repr(value)] for value in column])
    return Axis(name, labels, np.diff(edges), cells), np.clip(ndtri(edges), -Z_MAX, Z_MAX)


def _of_numbers(
    name: str, distribution: Distribution, asked: DomainCells | None, column: list[Value]
) -> tuple[Axis, Array]:
    """Cells between edges; the outer ones are open."""
    ends = _ends(distribution, Z_MAX)
    inner = _inner(distribution, asked)
    z = np.concatenate([[-Z_MAX], _z_below(distribution, inner), [Z_MAX]])
    bounded = hasattr(distribution, "high")
    if isinstance(distribution, Integers) or getattr(distribution, "whole", False):
        labels = _whole_labels([int(np.ceil(edge)) for edge in inner], ends, bounded=bounded)
    else:
        shown = [f"{edge:.4g}" for edge in inner]
        low = f"{ends[0]:.4g} to {shown[0]}" if bounded else f"below {shown[0]}"
        high = f"{shown[-1]} to {ends[1]:.4g}" if bounded else f"{shown[-1]} and more"
        labels = [low, *(f"{a} to {b}" for a, b in pairwise(shown)), high]
    cells = np.searchsorted(inner, np.array(column, np.float64), side="right")
    return Axis(name, labels, np.diff(ndtr(z)), cells), z


def _whole_labels(begins: list[int], ends: Array, *, bounded: bool) -> list[str]:
    """Cells of whole numbers; ``begins``: the first number of every cell but the first."""
    first, last = begins[0] - 1, begins[-1]
    low = _span(int(ends[0]), first) if bounded else f"{first} and less"
    high = _span(last, int(ends[1])) if bounded else f"{last} and more"
    return [low, *(_span(a, b - 1) for a, b in pairwise(begins)), high]


def _span(low: int, high: int) -> str:
    return f"{low}" if low >= high else f"{low} to {high}"


def _inner(distribution: Distribution, asked: DomainCells | None) -> Array:
    """Values between the cells."""
    if asked is not None and asked.edges is not UNSET:
        return np.array(asked.edges, np.float64)
    bins = BINS if asked is None or asked.bins is UNSET else asked.bins
    if isinstance(distribution, Integers):
        bins = min(bins, distribution.high - distribution.low + 1)
        ends = np.array([distribution.low - 0.5, distribution.high + 0.5])
    else:
        ends = _ends(distribution, -float(ndtri(TAIL)))
    return np.linspace(ends[0], ends[1], bins + 1)[1:-1]


def _ends(distribution: Distribution, reach: float) -> Array:
    """Smallest and largest value; of a distribution without, those of its normal variable."""
    match distribution:
        case Uniform() | TruncatedNormal() | Triangular() | Integers():
            return np.array([distribution.low, distribution.high], np.float64)
    return np.array(column_of(distribution, np.array([-reach, reach])), np.float64)


def _z_below(distribution: Distribution, edges: Array) -> Array:
    """The normal variable below which values are below each edge, by halving."""
    low, high = np.full(len(edges), -Z_MAX), np.full(len(edges), Z_MAX)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        below = np.array(column_of(distribution, middle), np.float64) < edges
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray(high)


def _together(one: Array, two: Array, rho: float) -> Array:
    """Probabilities of cells of two normal variables with a correlation, by Gauss's quadrature of
    the second given the first [cells of one, cells of two]."""
    rows = []
    for low, high in pairwise(one):
        x = low + (high - low) * (_NODES + 1) / 2
        density = np.exp(-x * x / 2) / np.sqrt(2 * np.pi) * _WEIGHTS * (high - low) / 2
        given = ndtr((two[None, :] - rho * x[:, None]) / np.sqrt(1 - rho * rho))
        rows.append(np.sum(density[:, None] * np.diff(given, axis=1), axis=0))
    return np.array(rows)
