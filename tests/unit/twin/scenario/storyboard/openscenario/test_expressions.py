"""Expressions against Python's own arithmetic."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin.scenario.storyboard.openscenario.expression import evaluate

NUMBERS = st.floats(0.001, 1000).map(lambda x: f"{x:.3f}")
SUMS = st.recursive(
    NUMBERS,
    lambda part: st.one_of(
        st.tuples(part, st.sampled_from("+-*"), part).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
        st.tuples(part, st.sampled_from("+-*"), part).map(lambda t: f"{t[0]}{t[1]}{t[2]}"),
        part.map(lambda x: f"-({x})"),
        part.map(lambda x: f"abs({x})"),
        st.tuples(part, part).map(lambda t: f"max({t[0]}, {t[1]})"),
    ),
    max_leaves=12,
)


@given(SUMS)
def test_arithmetic_is_that_of_python(text: str) -> None:
    expected = eval(text, {"__builtins__": {}}, {"abs": abs, "max": max})
    if math.isfinite(expected):
        assert evaluate(text, {}) == expected


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("round(2.5)", 3.0),
        ("round(-2.5)", -3.0),
        ("-7 % 3", -1.0),
        ("7 - 2 - 1", 4.0),
        ("2 ** 3", 8.0),
        ("-2 ** 2", -4.0),
        ("sign(-3) + floor(1.5) + ceil(1.5)", 2.0),
        ("sqrt(pow(3, 2) + 16)", 5.0),
        ("min(1, 2) < 2 and not false", True),
        ("$a * 2", 6.0),
        ("$flag or 1 == 2", True),
    ],
)
def test_value(text: str, value: float) -> None:
    assert evaluate(text, {"a": 3, "flag": True}) == value


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1 / 0", "divides by zero"),
        ("1 % (2 - 2)", "divides by zero"),
        ("$b + 1", r"parameter \$b in .* is not declared"),
        ("$s + 1", "is the string"),
        ("true + 1", "boolean stands where a number"),
        ("1 and true", "number stands where a boolean"),
        ("sqrt(-1)", "has no value"),
        ("random(1)", "'random' in .* is not known"),
        ("__import__", "is not known"),
        ("1 +", "ends too early"),
        ("1 2", "one too many"),
        ("(" * 200 + "1", "nests deeper"),
        ("pow(10, 999)", "too large"),
        ("1e308 * 10", "not a finite number"),
        ("pow(2)", "takes 2 values"),
    ],
)
def test_refusal(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        evaluate(text, {"s": "abc"})
