"""Margins of formulas agree with their definition, row by row, also where values are missing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.formulas.tree import AtLeast, Both, Column, Constant, Node, Not, Over, Until
from twin.kpi.robustness import evaluate, robustness

STEP_NS = 50_000_000


class Table:
    """Rows of two columns at 20 Hz; NaN: missing."""

    def __init__(self, **columns: list[float]) -> None:
        self._columns = {name: np.array(values) for name, values in columns.items()}
        self.rows = len(next(iter(self._columns.values())))

    def column(self, name: str) -> np.ndarray:
        """Values, 0 where missing."""
        if name == "sim_time_ns":
            return np.arange(self.rows) * STEP_NS
        return np.nan_to_num(self._columns[name])

    def valid(self, name: str) -> np.ndarray:
        """Which are there; only ``a`` may be missing."""
        if name != "a":
            raise KeyError(name)
        return ~np.isnan(self._columns[name])


NAN = float("nan")


@pytest.mark.parametrize(
    ("formula", "value"),
    [
        ("a > 1", 2.0),
        ("always a > 1", -0.5),
        ("eventually a > 1", 4.0),
        ("always b < 10", 6.0),
        ("always (a > 1 or b > 3.5)", 0.5),  # the row with a = 0.5 has b = 4
        ("always (a > 1 and b > 0)", -0.5),
        ("always[0, 0.05] a > 1", 2.0),  # a is missing in the second row
        ("eventually[0.05, 0.05] b > 0", 2.0),
        ("always[9, 10] a > 1", None),  # behind the last row
        ("b < 1.5 until a > 4.5", -0.5),  # b is 2 before a is 5
        ("b < 3.5 until a > 4.5", 0.5),
        ("b < 3.5 until[0, 0.05] a > 4.5", -1.5),
        ("not eventually a > 4", -1.0),
        ("a / (b - 1) > 0", None),  # a division by zero is unknown
        ("abs(b - 4) < 1", -2.0),
        ("a > 2 implies b > 2", -1.0),
    ],
)
def test_margins_by_hand(formula: str, value: float | None) -> None:
    rows = Table(a=[3.0, NAN, 5.0, 0.5], b=[1.0, 2.0, 3.0, 4.0])
    assert robustness(formula, rows) == value


def test_what_is_missing_breaks_nothing_and_keeps_nothing() -> None:
    rows = Table(a=[NAN, NAN], b=[1.0, 2.0])
    assert robustness("always a > 1", rows) is None
    assert robustness("eventually a > 1", rows) is None
    assert robustness("always (a > 1 or b > 5)", rows) is None
    assert robustness("always (a > 1 or b > 0)", rows) == 1.0
    assert robustness("always (a > 1 and b > 1.5)", rows) == -0.5
    assert robustness("always (a > 1 and b > 0)", rows) is None


def _naive(node: Node, rows: Table, row: int) -> float:
    """The definition, as slow as it is plain; NaN: unknown."""
    match node:
        case Constant():
            return node.value
        case Column():
            if node.name == "a" and not rows.valid("a")[row]:
                return NAN
            return float(rows.column(node.name)[row])
        case AtLeast():
            return _naive(node.large, rows, row) - _naive(node.small, rows, row)
        case Not():
            return -_naive(node.part, rows, row)
        case Both():
            sign = -1.0 if node.either else 1.0
            pair = [sign * _naive(part, rows, row) for part in (node.left, node.right)]
            known = [value for value in pair if not math.isnan(value)]
            if len(known) == 2 or (known and known[0] < 0):
                return sign * min(known)
            return NAN
        case Over():
            sign = -1.0 if node.once else 1.0
            margins = [sign * _naive(node.part, rows, other) for other in _rows(node, rows, row)]
            return sign * min((m for m in margins if not math.isnan(m)), default=NAN)
        case Until():
            best = -math.inf
            for other in _rows(node, rows, row):
                then = _naive(node.then, rows, other)
                before = [_naive(node.holds, rows, k) for k in range(row, other)]
                held = min((m for m in before if not math.isnan(m)), default=math.inf)
                best = max(best, -math.inf if math.isnan(then) else min(then, held))
            return best if math.isfinite(best) else NAN
    raise AssertionError(node)


def _rows(node: Any, rows: Table, row: int) -> list[int]:
    end_ns = math.inf if node.end_ns is None else node.end_ns
    apart = [(other - row) * STEP_NS for other in range(rows.rows)]
    return [other for other, ns in enumerate(apart) if node.begin_ns <= ns <= end_ns]


_ENDS = st.one_of(
    st.just((0, None)),
    st.tuples(st.integers(0, 3), st.integers(0, 4)).map(
        lambda p: (p[0] * STEP_NS, (p[0] + p[1]) * STEP_NS)
    ),
)
_LEAVES = st.builds(
    lambda name, bound, more: (
        AtLeast(Column(name), Constant(bound)) if more else AtLeast(Constant(bound), Column(name))
    ),
    st.sampled_from(["a", "b"]),
    st.integers(-4, 4).map(float),
    st.booleans(),
)
_TREES: st.SearchStrategy[Any] = st.recursive(
    _LEAVES,
    lambda parts: st.one_of(
        st.builds(Not, parts),
        st.builds(Both, parts, parts, st.booleans()),
        st.builds(lambda p, once, ends: Over(p, once, *ends), parts, st.booleans(), _ENDS),
        st.builds(lambda p, q, ends: Until(p, q, *ends), parts, parts, _ENDS),
    ),
    max_leaves=6,
)
_VALUES = st.integers(-6, 6).map(float)


@settings(max_examples=400, deadline=None)
@given(
    tree=_TREES,
    a=st.lists(st.one_of(_VALUES, st.just(NAN)), min_size=1, max_size=9),
    data=st.data(),
)
def test_margins_are_those_of_the_definition(tree: Any, a: list[float], data: Any) -> None:
    b = data.draw(st.lists(_VALUES, min_size=len(a), max_size=len(a)))
    rows = Table(a=a, b=b)
    mine = evaluate(tree, rows)
    np.testing.assert_array_equal(mine, [_naive(tree, rows, row) for row in range(rows.rows)])
