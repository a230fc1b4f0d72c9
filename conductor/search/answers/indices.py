"""Which parameter matters: variance-based indices, with 95 % intervals.

Saltelli's design gives Sobol indices of first and of total order (Saltelli et al., Computer
Physics Communications 181, 2010, table 2, b and f). Any other cases give an estimate of the first
order alone: the share of the variance that lies between classes of a parameter, without what
chance puts there (Plischke, Borgonovo and Smith, European Journal of Operational Research 226,
2013; the correction is Kelley's, PNAS 21, 1935).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from conductor.search.answers.case_rows import SearchRows
from conductor.search.intervals import Z
from conductor.search.protocol import Array
from conductor.search.samplers.saltelli import rows_of
from schemas.files.search_result import SearchIndices, SensitivityIndex
from schemas.identity import stream_key
from schemas.kinds.sampler import sampler_kinds
from schemas.sections.search import Search, Value

RESAMPLES = 999
"""Resamples of the design's rows, of whose indices an interval is the middle 95 %."""
TOGETHER = 37
"""Resamples at a time: all of them would take a quarter of a gigabyte."""
ROWS_MIN = 16
"""Fewest rows of a design."""
CASES_MIN = 100
"""Fewest cases that give an estimate without a design."""
CLASS_CASES, CLASSES_MAX = 25, 50
"""Cases of a class, about, and most classes of a parameter."""
EACH_MIN = 10
"""Fewest cases that fail, and that hold, for indices of failures."""


def search_indices(
    search: Search, campaign: str, seed: int, rows: SearchRows
) -> SearchIndices | None:
    """Which parameters matter; None: there are too few cases."""
    kind = sampler_kinds().find(search.sampler)
    if kind.gives == "indices":
        block = rows_of(len(search.parameters), min(search.budget.generation, search.budget.cases))
        stream = np.random.Philox(key=[stream_key(seed, campaign, "search/indices"), 0])
        return _of_design(search, rows, block, np.random.Generator(stream))
    if len(rows.g) < CASES_MIN:
        return None
    whose = "" if kind.follows else ", over the cases as proposed, not over the distributions"
    failed = rows.failed.astype(np.float64)
    enough = min(np.count_nonzero(failed), np.count_nonzero(1.0 - failed)) >= EACH_MIN
    return SearchIndices(
        method=f"first order from given data, by classes of each parameter{whose}; "
        "intervals by the jackknife",
        cases=len(rows.g),
        kpi=_of_classes(search, rows, rows.g),
        failure=_of_classes(search, rows, failed) if enough and _limited(search) else [],
    )


def _limited(search: Search) -> bool:
    return isinstance(search.objective.fails_below, float) or isinstance(
        search.objective.fails_above, float
    )


def _of_design(
    search: Search, rows: SearchRows, block: int, stream: np.random.Generator
) -> SearchIndices | None:
    """Indices of Saltelli's design, whose blocks follow each other."""
    dimension = len(search.parameters)
    blocks = len(rows.g) // (block * (dimension + 2))
    if blocks * block < ROWS_MIN:
        return None
    count = blocks * block
    key = int(stream.integers(2**63))
    failed = rows.failed.astype(np.float64)

    def indices(y: Array) -> list[SensitivityIndex]:
        # [A, B, A with columns of B][rows]
        parts = y[: count * (dimension + 2)].reshape(blocks, dimension + 2, block)
        return _sobol(list(search.parameters), parts.swapaxes(0, 1).reshape(-1, count), key)

    independent = failed[: count * (dimension + 2)].reshape(blocks, dimension + 2, block)[:, :2]
    hits = np.count_nonzero(independent)
    enough = min(hits, independent.size - hits) >= EACH_MIN
    return SearchIndices(
        method=f"Sobol indices of Saltelli's design with {count} rows; intervals by "
        f"{RESAMPLES} resamples of the rows",
        cases=len(rows.g),
        kpi=indices(rows.g),
        failure=indices(failed) if enough else [],
    )


def _sobol(names: list[str], parts: Array, key: int) -> list[SensitivityIndex]:
    """Indices of one value [A, B, A with columns of B][rows]; ``key`` draws the resamples of its
    rows, the same for every value."""
    y = parts - np.mean(parts[:2])
    a, b, mixed = y[0], y[1], y[2:]
    moments = np.stack([a, b, a * a, b * b])
    terms = np.concatenate([moments, b * (mixed - a), 0.5 * (a - mixed) ** 2])
    sums = _resampled(terms, key) / len(a)
    variance = (sums[:, 2] + sums[:, 3]) / 2 - ((sums[:, 0] + sums[:, 1]) / 2) ** 2
    if variance[0] <= 0:
        return []
    shares = sums[:, 4:][variance > 0] / variance[variance > 0][:, None]
    low, high = np.percentile(shares[1:], [2.5, 97.5], axis=0)
    total = len(names)
    return [
        SensitivityIndex(
            parameter=name,
            first=float(shares[0, i]),
            first_low=float(low[i]),
            first_high=float(high[i]),
            total=float(shares[0, total + i]),
            total_low=float(low[total + i]),
            total_high=float(high[total + i]),
        )
        for i, name in enumerate(names)
    ]


def _resampled(terms: Array, key: int) -> Array:
    """Sums of terms [terms, rows] over all rows, and over each resample [1 + resamples, terms]."""
    stream, count = np.random.default_rng(key), terms.shape[1]
    sums = [np.sum(terms, axis=1)[None, :]]
    for begin in range(0, RESAMPLES, TOGETHER):
        resamples = min(TOGETHER, RESAMPLES - begin)
        counts = stream.multinomial(count, np.full(count, 1.0 / count), resamples)
        # Not a product of matrices, whose sums go over threads.
        sums.append(np.einsum("rn,kn->rk", counts.astype(np.float64), terms))
    return np.concatenate(sums)


def _of_classes(search: Search, rows: SearchRows, y: Array) -> list[SensitivityIndex]:
    """Indices of first order of one value [cases]."""
    if np.ptp(y) == 0:
        return []
    found = []
    for place, name in enumerate(search.parameters):
        share, half = _between_classes(_classes(rows.column(place)), y)
        found.append(
            SensitivityIndex(
                parameter=name,
                first=max(0.0, share),
                first_low=max(0.0, share - half),
                first_high=min(1.0, max(0.0, share + half)),
            )
        )
    return found


def _classes(values: list[Value]) -> npt.NDArray[np.intp]:
    """The class of each value: about as many cases in each, equal values in one; words and truth
    values, one each."""
    if any(isinstance(value, bool | str) for value in values):
        order = {value: place for place, value in enumerate(dict.fromkeys(map(repr, values)))}
        return np.array([order[repr(value)] for value in values])
    numbers = np.array(values, np.float64)
    count = min(CLASSES_MAX, len(numbers) // CLASS_CASES)
    places = (np.arange(1, count) * len(numbers)) // count
    return np.searchsorted(np.sort(numbers)[places], numbers, side="right")


def _between_classes(classes: npt.NDArray[np.intp], y: Array) -> tuple[float, float]:
    """Share of the variance between classes, and half of its 95 % interval; classes of one case are
    left out.

    The interval is the jackknife's, and no narrower than what was taken off for chance: of points
    that are spread evenly, less is by chance than of independent ones.
    """
    sizes = np.bincount(classes)
    kept = sizes[classes] > 1
    classes, y = classes[kept], y[kept]
    count, groups = len(y), int(np.count_nonzero(sizes > 1))
    if count - 1 <= groups or np.ptp(y) == 0:
        return 0.0, 0.0
    m = sizes[classes].astype(np.float64)
    means = np.bincount(classes, y, len(sizes)) / np.maximum(sizes, 1)
    apart, apart_all = (y - means[classes]) ** 2, (y - np.mean(y)) ** 2
    within, whole = float(np.sum(apart)), float(np.sum(apart_all))
    share = 1.0 - within / (count - groups) * (count - 1) / whole
    # Without one case: what it adds to both sums goes, with its effect on the two means.
    fewer = within - apart * m / (m - 1)
    fewer_all = whole - apart_all * count / (count - 1)
    ratio = np.where(fewer_all > 0, fewer / np.maximum(fewer_all, 1e-300), 1.0)
    without = 1.0 - ratio * (count - 2) / (count - 1 - groups)
    spread = np.sum((without - np.mean(without)) ** 2) * (count - 1) / count
    chance = share - (1.0 - within / whole)
    return share, max(Z * math.sqrt(float(spread)), abs(chance))
