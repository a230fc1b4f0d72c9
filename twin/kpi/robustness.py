"""By how much the rows of a case keep a formula in signal temporal logic, or break it.

Robustness as of Donzé and Maler, Robust Satisfaction of Temporal Logic over Real-Valued Signals
(FORMATS 2010), on the rows of the control ticks: comparisons give a difference, ``and`` and
``always`` the smallest, ``or`` and ``eventually`` the largest. It is negative where the formula is
broken. Sums, products, differences, quotients and comparisons alone make it, so it has the same
bytes everywhere.

A missing value says nothing, as in Kleene's logic (Introduction to Metamathematics, 1952): NaN
stands for unknown. An ``and`` with one unknown side is known where the other is false, an ``or``
where the other is true. Temporal operators leave out rows whose condition is unknown.
"""

from __future__ import annotations

import math

import numpy as np

from schemas.formulas.parse import parse_formula
from schemas.formulas.tree import (
    Arithmetic,
    AtLeast,
    Both,
    Column,
    Constant,
    Node,
    Not,
    Over,
    Unary,
    Until,
)
from schemas.kinds.kpis.formula import ROBUSTNESS
from twin.scenario.protocol import Rows, Scalars


def formula_scalars(formula: str, rows: Rows) -> Scalars:
    """The robustness of a formula by its name as a scalar; nothing for an empty one."""
    return {ROBUSTNESS: robustness(formula, rows)} if formula else {}


def robustness(formula: str, rows: Rows) -> float | None:
    """The robustness of a formula at the first row; None: nothing is known.

    Raises:
        ValueError: the formula is none; one line.
    """
    with np.errstate(all="ignore"):
        value = float(evaluate(parse_formula(formula), rows)[0])
    return value + 0.0 if math.isfinite(value) else None


def evaluate(node: Node, rows: Rows) -> np.ndarray:
    """Numbers, or margins of a condition, float64 [rows]; NaN: missing, or unknown."""
    match node:
        case Constant():
            return np.full(rows.rows, node.value)
        case Column():
            return _column(node.name, rows)
        case Unary():
            part = evaluate(node.part, rows)
            return np.abs(part) if node.operator == "abs" else -part
        case Arithmetic():
            return _calculated(node, rows)
        case AtLeast():
            return _known(evaluate(node.large, rows) - evaluate(node.small, rows))
        case Not():
            return -evaluate(node.part, rows)
        case Both():
            left, right = evaluate(node.left, rows), evaluate(node.right, rows)
            return -_both(-left, -right) if node.either else _both(left, right)
        case Over():
            part = evaluate(node.part, rows)
            begin, end = _windows(rows, node.begin_ns, node.end_ns)
            return -_least(-part, begin, end) if node.once else _least(part, begin, end)
        case Until():
            return _until(evaluate(node.holds, rows), evaluate(node.then, rows), node, rows)


def _column(name: str, rows: Rows) -> np.ndarray:
    values = np.asarray(rows.column(name), np.float64)
    try:
        valid = rows.valid(name)
    except KeyError:  # a column that has no missing values
        return values
    return np.where(valid, values, np.nan)


def _calculated(node: Arithmetic, rows: Rows) -> np.ndarray:
    left, right = evaluate(node.left, rows), evaluate(node.right, rows)
    if node.operator == "+":
        return _known(left + right)
    if node.operator == "-":
        return _known(left - right)
    return _known(left * right if node.operator == "*" else left / right)


def _known(values: np.ndarray) -> np.ndarray:
    """Values with NaN in place of what is not finite."""
    return np.where(np.isfinite(values), values, np.nan)


def _both(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The smaller of two margins; where one is unknown, the other if it is negative."""
    least = np.fmin(left, right)
    unknown = np.isnan(left) | np.isnan(right)
    return np.where(unknown & ~(least < 0.0), np.nan, least)


def _windows(rows: Rows, begin_ns: int, end_ns: int | None) -> tuple[np.ndarray, np.ndarray]:
    """The rows that an interval begins and ends with, of every row; the end is not included."""
    time_ns = np.asarray(rows.column("sim_time_ns"), np.int64)
    begin = np.searchsorted(time_ns, time_ns + begin_ns, side="left")
    if end_ns is None:
        return begin, np.full(rows.rows, rows.rows)
    return begin, np.searchsorted(time_ns, time_ns + end_ns, side="right")


def _least(values: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The smallest known value of each window; NaN where none is known.

    From minima over runs of rows whose lengths are powers of two: two of them cover a window.
    """
    level, length = values, 1
    least = np.full(len(values), np.nan)
    while True:
        mine = (end - begin >= length) & (end - begin < 2 * length)
        least[mine] = np.fmin(level[begin[mine]], level[end[mine] - length])
        if 2 * length > len(values):
            return least
        level = np.fmin(level[:-length], level[length:])
        length *= 2


def _until(holds: np.ndarray, then: np.ndarray, node: Until, rows: Rows) -> np.ndarray:
    """The largest, over the rows of the interval, of ``then`` there and of ``holds`` before."""
    begin, end = _windows(rows, node.begin_ns, node.end_ns)
    kept = np.where(np.isnan(holds), np.inf, holds)
    met = np.where(np.isnan(then), -np.inf, then)
    values = np.full(rows.rows, np.nan)
    for row, (first, last) in enumerate(zip(begin.tolist(), end.tolist(), strict=True)):
        if first < last:
            before = np.minimum.accumulate(np.concatenate([[np.inf], kept[row : last - 1]]))
            values[row] = np.max(np.minimum(met[first:last], before[first - row :]))
    return _known(values)
