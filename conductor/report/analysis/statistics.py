"""Statistics of passed and failed cases: intervals, paired and unpaired tests, corrections.

Pure functions of counts. The simulator is deterministic, so an interval says how far the share
could lie from that of conditions like these, never how a repetition would differ.

The formulas are the closed ones of the sources named below, on the standard library: SciPy would
add 143 MB to every installation and 1.7 s to the start of a report.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist, median

LEVEL = 0.95
"""Confidence of every interval."""
ALPHA = 0.05
"""Level below which a corrected p-value counts as an effect."""
EXPECTED_MIN = 5.0
"""Smallest expected count with which the chi-square distribution is trusted (Cochran 1954)."""
EXACT_STEPS_MAX = 500_000
"""Longest way to an exact p-value, some tenths of a second; beyond it the chi-square distribution
has to do."""

_Z = NormalDist().inv_cdf(0.5 + LEVEL / 2)


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate and its bounds at :data:`LEVEL`."""

    estimate: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Homogeneity:
    """Whether groups pass equally often."""

    p_value: float
    chi_square: float
    """Pearson's statistic."""
    freedom: int
    exact: bool
    """Whether it is from the exact distribution given the sums, else from the chi-square
    distribution."""


def wilson(hits: int, total: int) -> tuple[float, float]:
    """Bounds of a share at 95 % (Wilson 1927, without continuity correction), 0 to 1.

    Raises:
        ValueError: no trials, or more hits than trials.
    """
    if not 0 <= hits <= total or total == 0:
        raise ValueError(f"{hits} of {total}: expected at least one trial and no more hits")
    share, square = hits / total, _Z * _Z
    middle = share + square / (2 * total)
    spread = _Z * math.sqrt(share * (1 - share) / total + square / (4 * total * total))
    scale = 1 + square / total
    low = 0.0 if hits == 0 else (middle - spread) / scale
    high = 1.0 if hits == total else (middle + spread) / scale
    return low, high


def newcombe_paired(both: int, first_only: int, second_only: int, neither: int) -> Interval:
    """First share less the second one, of the same cases (Newcombe 1998, paired, method 10).

    Args:
        both: cases that both pass.
        first_only: cases that only the first passes.
        second_only: cases that only the second passes.
        neither: cases that both lose.

    Raises:
        ValueError: no cases, or a negative count.
    """
    total = both + first_only + second_only + neither
    if min(both, first_only, second_only, neither) < 0:
        raise ValueError("expected counts of 0 or more")
    hits, other_hits = both + first_only, both + second_only
    (low, high), (other_low, other_high) = wilson(hits, total), wilson(other_hits, total)
    share, other = hits / total, other_hits / total
    phi = _phi(both, first_only, second_only, neither)

    def spread(one: float, two: float) -> float:
        return math.sqrt(max(0.0, one * one - 2 * phi * one * two + two * two))

    difference = (first_only - second_only) / total
    return Interval(
        difference,
        difference - spread(share - low, other_high - other),
        difference + spread(high - share, other - other_low),
    )


def _phi(both: int, first_only: int, second_only: int, neither: int) -> float:
    """Correlation of the pairs, with Newcombe's continuity correction where it is positive."""
    margins = (both + first_only) * (second_only + neither) * (both + second_only)
    margins *= first_only + neither
    if margins == 0:
        return 0.0
    product = float(both * neither - first_only * second_only)
    if product > 0:
        product = max(0.0, product - (both + first_only + second_only + neither) / 2)
    return product / math.sqrt(margins)


def mcnemar(first_only: int, second_only: int) -> float:
    """p-value of the exact two-sided McNemar test: paired cases, only those that differ count.

    Args:
        first_only: cases that only the first passes.
        second_only: cases that only the second passes.

    Raises:
        ValueError: a negative count.
    """
    if min(first_only, second_only) < 0:
        raise ValueError(f"{first_only} and {second_only}: expected counts of 0 or more")
    total = first_only + second_only
    tail = math.fsum(_half(total, k) for k in range(min(first_only, second_only) + 1))
    return min(1.0, 2 * tail)


def _half(total: int, number: int) -> float:
    """Probability of ``number`` heads in ``total`` tosses, in logarithms: 2**-total underflows."""
    ways = math.lgamma(total + 1) - math.lgamma(number + 1) - math.lgamma(total - number + 1)
    return math.exp(ways - total * math.log(2.0))


def homogeneity(groups: Sequence[tuple[int, int]]) -> Homogeneity:
    """Whether groups of (passed, cases) pass equally often: Pearson's chi-square.

    Where an expected count is below :data:`EXPECTED_MIN` the p-value is exact: the probability,
    given all sums, of a table at least as uneven.

    Raises:
        ValueError: fewer than two groups, or a group that is no share.
    """
    if len(groups) < 2 or any(not 0 <= passed <= count or not count for passed, count in groups):
        raise ValueError("expected two groups or more, each with a case and no more passes")
    counts = [count for _, count in groups]
    total, passed = sum(counts), sum(hits for hits, _ in groups)
    freedom = len(groups) - 1
    rarer = min(passed, total - passed)
    if rarer == 0:
        return Homogeneity(1.0, 0.0, freedom, exact=True)
    share = passed / total
    chi_square = sum((hits - share * n) ** 2 / n for hits, n in groups) / (share * (1 - share))
    if min(counts) * rarer / total < EXPECTED_MIN:
        events = [hits if rarer == passed else n - hits for hits, n in groups]
        p_value = _exact(events, counts)
        if p_value is not None:
            return Homogeneity(p_value, chi_square, freedom, exact=True)
    return Homogeneity(chi_square_tail(chi_square, freedom), chi_square, freedom, exact=False)


def _exact(events: list[int], counts: list[int]) -> float | None:
    """Probability, given the sums, of a sum of events^2 / count at least as large; None: too many
    ways. In whole numbers, so that ties are ties."""
    scale = math.lcm(*counts)
    weights = [scale // count for count in counts]
    observed = sum(w * e * e for w, e in zip(weights, events, strict=True))
    left = sum(events)
    ways: dict[tuple[int, int], int] = {(0, 0): 1}
    steps = 0
    for count, weight in zip(counts, weights, strict=True):
        sums: dict[tuple[int, int], int] = {}
        chosen = [math.comb(count, event) for event in range(min(count, left) + 1)]
        for (used, value), number in ways.items():
            most = min(count, left - used)
            steps += most + 1
            if steps > EXACT_STEPS_MAX:
                return None
            for event in range(most + 1):
                key = (used + event, value + weight * event * event)
                sums[key] = sums.get(key, 0) + number * chosen[event]
        ways = sums
    extreme = sum(
        number for (used, value), number in ways.items() if used == left if value >= observed
    )
    return extreme / math.comb(sum(counts), left)


def chi_square_tail(value: float, freedom: int) -> float:
    """Probability of a chi-square of at least ``value`` (Abramowitz and Stegun 26.4.4, 26.4.5)."""
    half = value / 2
    if half <= 0:
        return 1.0
    start = 0.5 if freedom % 2 else 0.0
    powers = (start + k for k in range(freedom // 2))
    # In logarithms: powers of large values overflow.
    terms = sum(math.exp(p * math.log(half) - half - math.lgamma(p + 1)) for p in powers)
    return min(1.0, terms + (math.erfc(math.sqrt(half)) if freedom % 2 else 0.0))


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values corrected for their number (Holm 1979), in the order given."""
    corrected = [0.0] * len(p_values)
    largest = 0.0
    order = sorted(range(len(p_values)), key=lambda i: (p_values[i], i))
    for rank, index in enumerate(order):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[index]))
        corrected[index] = largest
    return corrected


def median_interval(values: Sequence[float]) -> Interval | None:
    """Median with the exact bounds of the sign test, which ask nothing of the distribution.

    None where there are no values; with fewer than six no bounds hold at 95 %, so they are
    infinite.
    """
    if not values:
        return None
    ordered, total = sorted(values), len(values)
    rank = _sign_rank(total)
    low, high = (ordered[rank - 1], ordered[total - rank]) if rank else (-math.inf, math.inf)
    return Interval(float(median(ordered)), low, high)


def mean_interval(values: Sequence[float]) -> Interval | None:
    """Mean with Student's bounds: how far a few large differences move all. None without values;
    with fewer than six the bounds are infinite, as those of :func:`median_interval`."""
    if not values:
        return None
    total = len(values)
    mean = math.fsum(values) / total
    if _sign_rank(total) == 0:
        return Interval(mean, -math.inf, math.inf)
    # Squares of large values overflow; a power of two changes no other result.
    scale = math.ldexp(1.0, math.frexp(max(abs(value - mean) for value in values))[1])
    variance = math.fsum(((value - mean) / scale) ** 2 for value in values) / (total - 1)
    spread = _student(total - 1) * math.sqrt(variance / total) * scale
    return Interval(mean, mean - spread, mean + spread)


def _student(freedom: int) -> float:
    """Quantile of Student's t for :data:`LEVEL` (Abramowitz and Stegun 26.7.5); from five degrees
    of freedom on it is right to 0.2 %."""
    z, n = _Z, freedom
    return (
        z
        + (z**3 + z) / (4 * n)
        + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * n**2)
        + (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / (384 * n**3)
    )


def _sign_rank(total: int) -> int:
    """Largest rank r with P(binomial(total, 1/2) < r) <= (1 - LEVEL) / 2; 0: there is none."""
    tail, rank = 0.0, 0
    while True:
        tail += _half(total, rank)
        if tail > (1 - LEVEL) / 2:
            return rank
        rank += 1


def poisson_interval(count: int) -> tuple[float, float]:
    """Bounds of the mean of a Poisson count at 95 %, exact (Garwood 1936).

    The upper bound is the mean with which so few come with a probability of 2.5 %, the lower one
    that with which so many do. P(X <= n) of mean m is the tail of chi-square at 2 m with 2 n + 2
    degrees of freedom.

    Raises:
        ValueError: a negative count.
    """
    if count < 0:
        raise ValueError(f"{count}: expected a count of 0 or more")
    side = (1 - LEVEL) / 2
    low = _poisson_mean(count - 1, 1 - side) if count else 0.0
    return low, _poisson_mean(count, side)


def _poisson_mean(count: int, probability: float) -> float:
    """The mean with which at most ``count`` come with a probability, by bisection."""
    low, high = 0.0, 10.0 * (count + 2)
    for _ in range(100):
        middle = 0.5 * (low + high)
        if chi_square_tail(2 * middle, 2 * (count + 1)) > probability:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
