"""Formulas are read as they are written, and every broken one is one line."""

from __future__ import annotations

import pytest

from schemas.formulas.parse import FORMULA_CHARS_MAX, parse_formula
from schemas.formulas.tree import (
    DEPTH_MAX,
    Arithmetic,
    AtLeast,
    Both,
    Column,
    Constant,
    Not,
    Over,
    Unary,
    Until,
    columns_of,
)

A = AtLeast(Column("a"), Constant(1.0))
B = AtLeast(Constant(2.0), Column("b"))


@pytest.mark.parametrize(
    ("text", "tree"),
    [
        ("a > 1", A),
        ("1 <= a", A),
        ("not a >= 1", Not(A)),
        ("always a > 1 and b < 2", Both(Over(A, False, 0, None), B, either=False)),
        ("a > 1 or b < 2 and a > 1", Both(A, Both(B, A, either=False), either=True)),
        ("a > 1 implies b < 2", Both(Not(A), B, either=True)),
        ("eventually[0.5, 2] (a > 1)", Over(A, True, 500_000_000, 2_000_000_000)),
        ("a > 1 until b < 2", Until(A, B, 0, None)),
        ("a > 1 until [1, 2] b < 2", Until(A, B, 1_000_000_000, 2_000_000_000)),
        (
            "abs(a - 2 * b) > -1e-1",
            AtLeast(
                Unary(
                    "abs",
                    Arithmetic("-", Column("a"), Arithmetic("*", Constant(2.0), Column("b"))),
                ),
                Unary("negative", Constant(0.1)),
            ),
        ),
        ("always_on > 1", AtLeast(Column("always_on"), Constant(1.0))),
        ("(" * 200 + "a > 1" + ")" * 200, A),
    ],
)
def test_a_formula_is_read(text: str, tree: object) -> None:
    assert parse_formula(text) == tree


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (" ", "empty; say what is to hold"),
        ("a >", "ends too early"),
        ("a > 1 > 2", "'>' is not expected at character 7"),
        ("a == 1", "'==' is not expected at character 3"),
        ("a > 1 & b < 2", "'&' is not expected at character 7"),
        ("always a", "'a' has no bound; compare it"),
        ("3", "a number has no bound"),
        ("2 > 1", "names no column"),
        ("(a > 1) + 2 > 1", "a condition stands where a number is needed"),
        ("always[2, 1] a > 1", "interval [2, 1]; allowed: 0 <= begin <= end"),
        ("a > 1e999", "number 1e999 is too large"),
        ("not " * DEPTH_MAX + "a > 1", f"more than {DEPTH_MAX} operators inside each other"),
        ("a" * (FORMULA_CHARS_MAX + 1), f"at most {FORMULA_CHARS_MAX} are allowed"),
    ],
)
def test_a_broken_formula_is_one_line(text: str, line: str) -> None:
    with pytest.raises(ValueError) as error:
        parse_formula(text)
    assert line in str(error.value)
    assert "\n" not in str(error.value)


def test_columns_are_named_once_from_left_to_right() -> None:
    assert columns_of(parse_formula("b > 1 and (a < 1 or b / c > 2) until a > 0")) == [
        "b",
        "a",
        "c",
    ]
