"""Bayesian search: the next cases are where a worse one is most to be expected."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from conductor.search.protocol import Array, Estimate, History, Problem, Streams
from conductor.search.samplers.gaussian_process import Candidates, Surrogate
from schemas.kinds.sampler import BayesianOptions

FIRST_MIN = 4
"""Fewest cases before the first fit; more where there are more than one parameter."""
CANDIDATES = 2000
"""Places of each generation over the whole domain, and as many around its worst cases."""
AROUND = 8
"""Worst cases around which candidates lie."""
APART = 0.1
"""Distance of these from each other, in shares times the root of the number of parameters."""
MOVED = 0.5
"""Chance of a parameter to be moved away from theirs."""
REACHES = (0.3, 0.1, 0.03, 0.01, 0.003)
"""Spreads of candidates around them, in shares."""
MARGIN = 1e-6
"""Shares nearer to 0 and 1 than this are not proposed."""
SQRT_TWO_PI = 2.5066282746310002


class Bayesian:
    """Expected improvement over candidates of a keyed stream (Jones, Schonlau and Welch, Journal of
    Global Optimization 13, 1998).

    The cases of a generation are chosen one after the other, each as if those before had come out
    as is likely. A share of them is far from all others: a process that was fitted around one
    extreme is too sure that there is no other.
    """

    def __init__(self, options: BayesianOptions, problem: Problem) -> None:
        self._options, self._problem = options, problem

    def propose(self, history: History, streams: Streams) -> Array:
        """Points that are spread evenly first, then those with the best expectation."""
        dimension = self._problem.dimension
        count = min(self._problem.generation, self._problem.cases - history.cases)
        if count < 1:
            return np.zeros((0, dimension))
        first = max(FIRST_MIN, 2 * dimension + 2, self._options.first)
        if history.cases < first:
            shares = _spread(dimension, history.cases + count, streams("first points"))
            return _coordinates(shares[history.cases :])
        stream = streams(f"generation {len(history.g)}")
        places, margins = ndtr(np.concatenate(history.u)), np.concatenate(history.g)
        process = Surrogate(places, margins)
        candidates = process.at(_candidates(places, margins, stream))
        return _coordinates(_batch(process, candidates, count, self._options.explore))

    def answer(self, _history: History) -> Estimate:
        """No probability: its points are where it is bad."""
        return Estimate(method="Bayesian search; an extreme, no probability")


def _batch(process: Surrogate, candidates: Candidates, count: int, explored: float) -> Array:
    """The candidates with the greatest expected improvement, each after those before; a share of
    them is where no case is near."""
    least, chosen = process.least, list[int]()
    distance = np.min(_squares(candidates.places[:CANDIDATES], process.places), axis=1)
    for number in range(count):
        if int((number + 1) * explored) > int(number * explored):
            index = int(np.argmax(distance))
        else:
            gain = improvement(candidates.mean, candidates.variance, least)
            gain[chosen] = -1.0
            index = int(np.argmax(gain))
        chosen.append(index)
        least = min(least, float(candidates.mean[index]))
        process.believe(candidates, index)
        place = candidates.places[index : index + 1]
        distance = np.minimum(distance, _squares(candidates.places[:CANDIDATES], place)[:, 0])
    return candidates.places[chosen]


def _squares(places: Array, others: Array) -> Array:
    """Squares of distances [places, others]."""
    columns = [(one[:, None] - other) ** 2 for one, other in zip(places.T, others.T, strict=True)]
    return np.asarray(sum(columns))


def improvement(mean: Array, variance: Array, least: float) -> Array:
    """How far below ``least`` a normal variable is expected to be [candidates]."""
    sd = np.sqrt(np.maximum(variance, 1e-18))
    z = (least - mean) / sd
    return np.asarray(sd * (z * ndtr(z) + np.exp(-0.5 * z * z) / SQRT_TWO_PI))


def _candidates(places: Array, margins: Array, stream: np.random.Generator) -> Array:
    """Places over the whole domain, and around the worst cases; shares."""
    dimension = places.shape[1]
    everywhere = stream.random((CANDIDATES, dimension))
    centres = _apart(places, margins)[np.arange(CANDIDATES) % AROUND]
    reach = np.array(REACHES)[(np.arange(CANDIDATES) // AROUND) % len(REACHES)]
    steps = reach[:, None] * stream.standard_normal((CANDIDATES, dimension))
    # Some parameters alone: what is better may lie along one of them.
    moved = stream.random((CANDIDATES, dimension)) < MOVED
    moved[np.arange(CANDIDATES), stream.integers(dimension, size=CANDIDATES)] = True
    near = centres + np.where(moved, steps, 0.0)
    # Beyond an end: back from it, so that places at an end are not all the same.
    near = 1.0 - np.abs(1.0 - np.abs(near))
    return np.asarray(np.clip(np.concatenate([everywhere, near]), MARGIN, 1.0 - MARGIN))


def _apart(places: Array, margins: Array) -> Array:
    """The worst case, the worst of those that are not near it, and so on [AROUND, parameters]."""
    order = np.argsort(margins, kind="stable")
    left, centres = places[order], list[Array]()
    while len(centres) < AROUND:
        centres.append(left[0])
        distant = np.sum((left - left[0]) ** 2, axis=1) > APART**2 * places.shape[1]
        left = left[distant] if np.any(distant) else places[order]
    return np.array(centres)


def _spread(dimension: int, count: int, stream: np.random.Generator) -> Array:
    """The first points of a scrambled Sobol sequence [count, parameters]; shares."""
    numbers = np.random.default_rng(int(stream.integers(2**63)))
    exponent = max(1, (count - 1).bit_length())
    unit = qmc.Sobol(dimension, rng=numbers).random_base2(exponent)
    return np.asarray(np.clip(unit[:count], MARGIN, 1.0 - MARGIN))


def _coordinates(shares: Array) -> Array:
    return np.asarray(ndtri(shares), np.float64)
