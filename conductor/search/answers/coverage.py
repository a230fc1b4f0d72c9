"""Which cells of a domain were tried, and which never: parameters, and pairs of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from conductor.search.protocol import Array
from schemas.files.search_result import (
    CoveredPair,
    CoveredParameter,
    SearchCoverage,
    UntriedCell,
)

Flags = npt.NDArray[np.bool_]

POSSIBLE_MIN = 1e-12
"""Smallest probability of a cell that counts as possible."""
UNTRIED_MAX = 50
"""Most cells that are listed."""
DIGITS = 6
"""Significant digits of a probability."""


@dataclass(frozen=True, slots=True)
class Axis:
    """One parameter: its cells, and in which of them every case lies."""

    name: str
    labels: Sequence[str]
    weights: Array
    """Probability of each cell."""
    cells: npt.NDArray[np.intp]
    """Cell of each case."""


def coverage_of(
    axes: Sequence[Axis], together: Mapping[tuple[int, int], Array] | None = None
) -> SearchCoverage:
    """What was tried.

    Args:
        axes: the parameters.
        together: probabilities of pairs that depend on each other, by their places, the smaller
            first [cells of the first, cells of the second].
    """
    joint = together or {}
    counts = [np.bincount(axis.cells, minlength=len(axis.labels)) for axis in axes]
    pairs: list[tuple[CoveredPair, list[UntriedCell]]] = []
    for i, j in combinations(range(len(axes)), 2):
        weights = joint.get((i, j), np.outer(axes[i].weights, axes[j].weights))
        pairs.append(_pair(axes[i], axes[j], weights, (counts[i] > 0, counts[j] > 0)))
    pairs.sort(key=lambda pair: -pair[0].untried)
    untried = [
        cell for axis, count in zip(axes, counts, strict=True) for cell in _alone(axis, count)
    ]
    untried += [cell for _, cells in pairs for cell in cells]
    untried.sort(key=lambda cell: -cell.weight)
    return SearchCoverage(
        cases=len(axes[0].cells) if axes else 0,
        parameters=[
            CoveredParameter(
                parameter=axis.name,
                cells=list(axis.labels),
                weights=_rounded(axis.weights),
                cases=[int(n) for n in count],
            )
            for axis, count in zip(axes, counts, strict=True)
        ],
        pairs=[pair for pair, _ in pairs],
        untried=untried[:UNTRIED_MAX],
    )


def _alone(axis: Axis, count: npt.NDArray[np.intp]) -> list[UntriedCell]:
    """Cells of one parameter without a case."""
    return [
        UntriedCell(parameters=[axis.name], cells=[label], weight=_rounded([weight])[0])
        for label, weight, cases in zip(axis.labels, axis.weights, count, strict=True)
        if not cases and weight > POSSIBLE_MIN
    ]


def _pair(
    one: Axis, two: Axis, weights: Array, tried_alone: tuple[Flags, Flags]
) -> tuple[CoveredPair, list[UntriedCell]]:
    """Two parameters; and their largest cells without a case, though each of the two was tried."""
    shape = (len(one.labels), len(two.labels))
    cases = np.bincount(one.cells * shape[1] + two.cells, minlength=shape[0] * shape[1])
    cases = cases.reshape(shape)
    possible = weights > POSSIBLE_MIN
    missing = possible & (cases == 0)
    names = [one.name, two.name]
    pair = CoveredPair(
        parameters=names,
        possible=int(np.count_nonzero(possible)),
        tried=int(np.count_nonzero(possible & (cases > 0))),
        untried=_rounded([float(np.sum(weights[missing]))])[0],
        weights=[_rounded(row) for row in weights],
        cases=[[int(n) for n in row] for row in cases],
    )
    of_both = missing & tried_alone[0][:, None] & tried_alone[1][None, :]
    places = sorted(np.argwhere(of_both).tolist(), key=lambda place: -weights[*place])
    cells = [
        UntriedCell(
            parameters=names,
            cells=[one.labels[a], two.labels[b]],
            weight=_rounded([weights[a, b]])[0],
        )
        for a, b in places[:UNTRIED_MAX]
    ]
    return pair, cells


def _rounded(weights: Sequence[float] | Array) -> list[float]:
    return [float(f"{weight:.{DIGITS}g}") for weight in weights]
