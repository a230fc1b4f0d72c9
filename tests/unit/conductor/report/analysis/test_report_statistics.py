"""Statistics against published values, against counting every table, and at their edges."""

from __future__ import annotations

import itertools
import math
import statistics

import pytest

from conductor.report.analysis.statistics import (
    EXACT_STEPS_MAX,
    chi_square_tail,
    holm,
    homogeneity,
    mcnemar,
    mean_interval,
    median_interval,
    newcombe_paired,
    poisson_interval,
    wilson,
)


@pytest.mark.parametrize(
    ("hits", "total", "low", "high"),
    [
        # Newcombe 1998, Statistics in Medicine 17, 857: table I, method 3.
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
        (8, 10, 0.49016, 0.94332),
        (10, 10, 0.72247, 1.0),
        (1, 1, 0.20655, 1.0),
    ],
)
def test_wilson_intervals(hits: int, total: int, low: float, high: float) -> None:
    assert wilson(hits, total) == pytest.approx((low, high), abs=5e-5)


@pytest.mark.parametrize(("hits", "total"), [(0, 5), (61, 64), (1, 256), (7, 7)])
def test_wilson_bounds_solve_the_score_equation(hits: int, total: int) -> None:
    for bound in wilson(hits, total):
        off = abs(hits / total - bound)
        assert off == pytest.approx(1.959964 * (bound * (1 - bound) / total) ** 0.5, abs=1e-7)


@pytest.mark.parametrize(("hits", "total"), [(0, 0), (3, 2), (-1, 2)])
def test_wilson_refuses_what_is_no_share(hits: int, total: int) -> None:
    with pytest.raises(ValueError, match=f"{hits} of {total}"):
        wilson(hits, total)


def test_newcombe_of_paired_cases() -> None:
    # Newcombe 1998, Statistics in Medicine 17, 2635: table II, method 10.
    found = newcombe_paired(36, 12, 2, 0)
    assert (found.estimate, found.low, found.high) == pytest.approx((0.2, 0.0569, 0.3404), abs=5e-5)
    turned = newcombe_paired(36, 2, 12, 0)
    assert (turned.low, turned.high) == pytest.approx((-found.high, -found.low))
    same = newcombe_paired(54, 0, 0, 0)
    assert (same.estimate, same.low, same.high) == pytest.approx((0.0, -0.0664, 0.0664), abs=5e-5)
    with pytest.raises(ValueError, match="0 or more"):
        newcombe_paired(1, -1, 0, 0)
    with pytest.raises(ValueError, match="at least one trial"):
        newcombe_paired(0, 0, 0, 0)


def test_mcnemar_is_the_binomial_test_of_those_that_differ() -> None:
    assert mcnemar(0, 0) == 1.0
    assert mcnemar(5, 5) == 1.0
    assert mcnemar(9, 0) == pytest.approx(2 / 2**9)
    assert mcnemar(0, 9) == mcnemar(9, 0)
    # Agresti, Categorical Data Analysis, table of 150 and 86 changed approvals; SciPy's binomtest.
    assert mcnemar(86, 150) == pytest.approx(3.7159361395713866e-05, rel=1e-9)
    assert mcnemar(40_000, 41_000) == pytest.approx(0.0004478218231, rel=1e-9)
    with pytest.raises(ValueError, match="0 or more"):
        mcnemar(-1, 3)


def counted(groups: list[tuple[int, int]]) -> float:
    """The exact p-value by listing which cases pass: slow, and nothing can be wrong with it."""
    owners = [index for index, (_, count) in enumerate(groups) for _ in range(count)]
    passed = sum(hits for hits, _ in groups)

    def uneven(hits: list[int]) -> float:
        return sum(h * h / count for h, (_, count) in zip(hits, groups, strict=True))

    seen, extreme, total = uneven([hits for hits, _ in groups]), 0, 0
    for chosen in itertools.combinations(owners, passed):
        total += 1
        extreme += uneven([chosen.count(i) for i in range(len(groups))]) >= seen - 1e-12
    return extreme / total


@pytest.mark.parametrize(
    "groups",
    [
        [(3, 4), (1, 4)],
        [(9, 10), (3, 7)],
        [(3, 5), (0, 3), (4, 4), (2, 6)],
        [(5, 5), (5, 5), (1, 5)],
    ],
)
def test_the_exact_test_counts_tables(groups: list[tuple[int, int]]) -> None:
    found = homogeneity(groups)
    assert found.exact
    assert found.p_value == pytest.approx(counted(groups), rel=1e-12)
    lost = [(count - hits, count) for hits, count in groups]
    assert homogeneity(lost).p_value == found.p_value
    assert homogeneity(lost).chi_square == pytest.approx(found.chi_square)


def test_large_tables_take_the_chi_square_distribution() -> None:
    # SciPy: chi2_contingency([[24, 40], [30, 34], [50, 14]], correction=False).
    found = homogeneity([(24, 64), (30, 64), (50, 64)])
    assert (found.exact, found.freedom) == (False, 2)
    assert found.chi_square == pytest.approx(23.32867132867133)
    assert found.p_value == pytest.approx(8.594950620094526e-06)


def test_groups_without_a_difference_and_groups_that_are_none() -> None:
    assert homogeneity([(4, 4), (9, 9)]).p_value == 1.0
    assert homogeneity([(0, 4), (0, 9)]).p_value == 1.0
    for groups in ([(1, 2)], [(1, 2), (0, 0)], [(1, 2), (3, 2)], [(1, 2), (-1, 2)]):
        with pytest.raises(ValueError, match="two groups"):
            homogeneity(groups)


def test_too_many_ways_fall_back_and_say_so() -> None:
    uneven = [(count - 1 - count % 4, count) for count in range(23, 47)]
    assert math.lcm(*(count for _, count in uneven)) > EXACT_STEPS_MAX
    found = homogeneity(uneven)
    assert not found.exact
    assert found.p_value == chi_square_tail(found.chi_square, 23)


@pytest.mark.parametrize(
    ("value", "freedom", "tail"),
    # SciPy: chi2.sf.
    [
        (3.84, 1, 0.05004352124870519),
        (10.0, 4, 0.04042768199451279),
        (20.3, 7, 0.004956865959576419),
        (1200.0, 999, 1.112935044825893e-05),
        (0.0, 3, 1.0),
        (9000.0, 2, 0.0),
    ],
)
def test_tail_of_chi_square(value: float, freedom: int, tail: float) -> None:
    assert chi_square_tail(value, freedom) == pytest.approx(tail, rel=1e-9)


def test_holm_keeps_order_and_never_falls() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []


@pytest.mark.parametrize(
    ("total", "rank"), [(6, 1), (9, 2), (20, 6), (50, 18), (100, 40), (20_000, 9861)]
)
def test_bounds_of_a_median_are_order_statistics(total: int, rank: int) -> None:
    # Ranks: SciPy's binom.ppf(0.025, total, 0.5).
    found = median_interval([float(value) for value in range(1, total + 1)])
    assert found is not None
    assert (found.low, found.high) == (rank, total - rank + 1)
    assert found.estimate == (total + 1) / 2


def test_few_values_have_a_median_without_bounds() -> None:
    assert median_interval([]) is None
    found = median_interval([3.0, 1.0, 2.0])
    assert found is not None
    assert (found.estimate, found.low, found.high) == (2.0, -math.inf, math.inf)


@pytest.mark.parametrize(
    ("total", "quantile"),
    # Tables of Student's t for 5, 9, 29 and 999 degrees of freedom.
    [(6, 2.5706), (10, 2.2622), (30, 2.0452), (1000, 1.9623)],
)
def test_bounds_of_a_mean_are_students(total: int, quantile: float) -> None:
    values = [float(value % 7) for value in range(total)]
    found = mean_interval(values)
    assert found is not None
    spread = statistics.stdev(values) / math.sqrt(total) * quantile
    assert found.estimate == pytest.approx(statistics.mean(values))
    assert found.high - found.estimate == pytest.approx(spread, rel=0.002)
    assert found.estimate - found.low == pytest.approx(spread, rel=0.002)


def test_means_of_few_and_of_equal_values() -> None:
    assert mean_interval([]) is None
    few, same = mean_interval([1.0, 2.0]), mean_interval([0.25] * 9)
    assert few is not None
    assert (few.estimate, few.low, few.high) == (1.5, -math.inf, math.inf)
    assert same is not None
    assert (same.estimate, same.low, same.high) == (0.25, 0.25, 0.25)


def test_large_values_have_a_mean_too() -> None:
    found = mean_interval([1e200, -1e200, 1e200, -1e200, 1e200, -1e200, 1e200, -1e200])
    assert found is not None
    assert found.estimate == 0.0
    assert 1e199 < found.high < 1e201


@pytest.mark.parametrize("total", [1, 3, 7, 10, 64, 250, 1999])
def test_bounds_of_none_and_of_all_are_exact(total: int) -> None:
    assert wilson(0, total)[0] == 0.0
    assert wilson(total, total)[1] == 1.0


def test_newcombe_where_pairs_go_together_and_where_a_margin_is_empty() -> None:
    # Newcombe 1998: table II, method 10.
    found = newcombe_paired(20, 12, 2, 16)
    assert (found.estimate, found.low, found.high) == pytest.approx((0.2, 0.0562, 0.3292), abs=5e-5)
    # Without a pass on one side there is no correlation: the bounds add up as squares.
    found = newcombe_paired(0, 0, 3, 2)
    (_, high), (low, _) = wilson(0, 5), wilson(3, 5)
    assert found.high == pytest.approx(-0.6 + math.hypot(high, 0.6 - low), rel=1e-12)
    for counts in ((-1, 5, 5, 5), (5, 5, -1, 5), (5, 5, 5, -1)):
        with pytest.raises(ValueError, match="0 or more"):
            newcombe_paired(*counts)


def test_the_tail_of_small_chi_squares() -> None:
    assert chi_square_tail(1.0, 2) == pytest.approx(math.exp(-0.5), rel=1e-12)
    assert chi_square_tail(0.0, 3) == 1.0


def test_one_small_group_among_large_ones_is_counted_exactly() -> None:
    assert homogeneity([(1, 4), (60, 100)]).exact is True
    assert homogeneity([(50, 100), (60, 100)]).exact is False


def test_the_quantile_of_many_degrees_of_freedom_is_exact() -> None:
    """2.0422724563 for 30 (tables of Student's t)."""
    values = [float(value % 7) for value in range(31)]
    found = mean_interval(values)
    assert found is not None
    spread = statistics.stdev(values) / math.sqrt(31) * 2.0422724563
    assert found.high - found.estimate == pytest.approx(spread, rel=1.3e-6)


def test_what_a_test_of_groups_says_beside_its_p_value() -> None:
    for groups in ([(0, 4), (0, 9)], [(4, 4), (9, 9), (1, 1)]):
        same = homogeneity(groups)
        assert (same.p_value, same.chi_square) == (1.0, 0.0)
        assert (same.freedom, same.exact) == (len(groups) - 1, True)
    exact = homogeneity([(1, 4), (3, 4), (2, 5)])
    assert (exact.freedom, exact.exact) == (2, True)


@pytest.mark.parametrize(
    ("count", "low", "high"),
    [(0, 0.0, 3.6889), (1, 0.0253, 5.5716), (2, 0.2422, 7.2247), (10, 4.7954, 18.3904)],
)
def test_bounds_of_a_count_are_the_exact_ones(count: int, low: float, high: float) -> None:
    """Garwood 1936, as every table of exact Poisson limits has them."""
    assert poisson_interval(count) == pytest.approx((low, high), abs=5e-5)


def test_a_negative_count_has_no_bounds() -> None:
    with pytest.raises(ValueError, match="0 or more"):
        poisson_interval(-1)
