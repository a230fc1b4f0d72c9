"""Where cases fail and where they hold, in the two parameters that matter most: a map from given
data.

The share of failures at a point is that of its nearest cases, nearer ones with more weight
(Epanechnikov's kernel, as wide as the furthest of them; Loftsgaarden and Quesenberry, Annals of
Mathematical Statistics 36, 1965). Nearness is that of the normal variables behind the parameters,
and all other parameters are as they happened to be.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from conductor.search.answers.case_rows import SearchRows
from conductor.search.protocol import Array
from conductor.search.space import column_of, normals_of
from schemas.files.search_result import FailureMap, SearchIndices, SensitivityIndex
from schemas.kinds.sampler import sampler_kinds
from schemas.sections.search import Choices, Search

POINTS = 41
"""Points of the map in each direction."""
NEAREST_MIN = 10
"""Fewest nearest cases; else the root of their number."""
APART_MAX = 1.0
"""Distance from the nearest case beyond which nothing is said, in standard deviations."""
DIGITS = 3
"""Digits of a share."""


def failure_map(
    search: Search, rows: SearchRows, indices: SearchIndices | None
) -> FailureMap | None:
    """The map; None: too few cases fail, or hold, or too few parameters are numbers."""
    if indices is None or not indices.failure:
        return None
    numbers = [
        index.parameter
        for index in sorted(indices.failure, key=_weight, reverse=True)
        if not isinstance(search.parameters[index.parameter], Choices)
    ]
    if len(numbers) < 2:
        return None
    names = list(search.parameters)
    places = [names.index(name) for name in numbers[:2]]
    z = normals_of(search, rows.u)[:, places]
    count = max(NEAREST_MIN, round(math.sqrt(len(z))))
    axes = [np.linspace(np.min(z[:, i]), np.max(z[:, i]), POINTS) for i in (0, 1)]
    share = _shares(z, rows.failed.astype(np.float64), axes, count)
    follows = sampler_kinds().find(search.sampler).follows
    whose = "" if follows else ", which do not follow the distributions"
    x, y = (
        [float(v) for v in column_of(search.parameters[name], axis)]
        for name, axis in zip(numbers, axes, strict=False)
    )
    return FailureMap(
        parameters=numbers[:2],
        method=f"share of failures of the {count} nearest of {len(z)} cases{whose}, nearer ones "
        "with more weight; the other parameters are as they were",
        x=x,
        y=y,
        share=share,
    )


def _weight(index: SensitivityIndex) -> float:
    return index.first if index.total is None else index.total


def _shares(z: Array, failed: Array, axes: list[Array], count: int) -> list[list[float | None]]:
    """Share of failures at every point of a grid [y][x]; None: no case is near."""
    x, y = np.meshgrid(axes[0], axes[1])
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    apart, nearest = cKDTree(z).query(points, k=min(count, len(z)))
    widest = np.maximum(apart[:, -1:], 1e-12) * (1 + 1e-9)
    weights = 1.0 - (apart / widest) ** 2 + 1e-9
    shares = np.sum(weights * failed[nearest], axis=1) / np.sum(weights, axis=1)
    told = [
        round(float(share), DIGITS) if near <= APART_MAX else None
        for share, near in zip(shares, apart[:, 0], strict=True)
    ]
    return [told[row * len(axes[0]) : (row + 1) * len(axes[0])] for row in range(len(axes[1]))]
