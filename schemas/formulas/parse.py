"""From the text of a formula to its tree."""

from __future__ import annotations

import functools
import math
from typing import Any

from schemas.escape import escape
from schemas.formulas.tree import (
    DEPTH_MAX,
    NUMBERS,
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
    columns_of,
    parts_of,
)

FORMULA_CHARS_MAX = 1000
"""Longest formula [characters]."""
SECONDS_MAX = 1e6
"""Largest bound of an interval [s]."""

GRAMMAR = r"""
?start: implies
?implies: either ("implies" implies)?
?either: both | either "or" both
?both: until | both "and" until
?until: unary | unary "until" interval? unary
?unary: order
      | "not" unary -> opposite
      | "always" interval? unary -> always
      | "eventually" interval? unary -> eventually
?order: sum
      | sum MORE sum -> more
      | sum LESS sum -> less
?sum: product | sum PLUS product -> arithmetic | sum MINUS product -> arithmetic
?product: signed | product TIMES signed -> arithmetic | product BY signed -> arithmetic
?signed: atom | MINUS signed -> negative
?atom: NUMBER -> number
     | NAME -> column
     | "abs" "(" sum ")" -> size
     | "(" implies ")"
interval: "[" NUMBER "," NUMBER "]"
MORE: ">=" | ">"
LESS: "<=" | "<"
PLUS: "+"
MINUS: "-"
TIMES: "*"
BY: "/"
NAME: /[a-z_][a-z0-9_]*/
NUMBER: /[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?|\.[0-9]+([eE][+-]?[0-9]+)?/
%ignore /[ \t\r\n]+/
"""
"""The language; a word is one of its own before it is the name of a column."""


@functools.lru_cache(maxsize=64)
def parse_formula(text: str) -> Node:
    """The condition that a text says.

    Raises:
        ValueError: it says none; one line with the place.
    """
    formula: Node = _condition(_parsed(text, "say what is to hold, as in 'always (ttc_s > 1.0)'"))
    if not columns_of(formula):
        raise ValueError("names no column; say what is to hold, as in 'always (ttc_s > 1.0)'")
    return formula


@functools.lru_cache(maxsize=64)
def parse_row_formula(text: str) -> Node:
    """The number, or the condition, that a text says of a single row.

    Raises:
        ValueError: it says none, or looks at other rows; one line.
    """
    formula: Node = _parsed(text, "say what a row is worth, as in 'speed_mps - 2 * collisions'")
    level: list[Node] = [formula]
    while level:
        node = level.pop()
        if isinstance(node, Over | Until):
            raise ValueError(
                "always, eventually and until look at other rows; this formula is of a single one"
            )
        level += parts_of(node)
    return formula


def _parsed(text: str, example: str) -> Any:
    """The node that a text says, a number or a condition; ``example`` is told of an empty text."""
    import lark  # late: only who has a formula waits for it

    if len(text) > FORMULA_CHARS_MAX:
        raise ValueError(f"{len(text)} characters, at most {FORMULA_CHARS_MAX} are allowed")
    if not text.strip():
        raise ValueError(f"empty; {example}")
    try:
        return _parser().parse(text)
    except lark.UnexpectedInput as error:
        raise ValueError(_unexpected(text, error)) from None


def _unexpected(text: str, error: Any) -> str:
    if getattr(getattr(error, "token", None), "type", "") == "$END":
        return "ends too early; something is missing behind its last word"
    place = error.pos_in_stream
    word = escape(text[place : place + 20].split(" ")[0] or " ", 80)
    return f"'{word}' is not expected at character {place + 1}"


@functools.cache
def _parser() -> Any:
    import lark

    # Made while it is parsed, from below: a deep text needs no deep stack.
    return lark.Lark(GRAMMAR, parser="lalr", transformer=_Nodes())


class _Nodes:
    """Makes nodes of the parts of a rule, by the rule's name."""

    def number(self, parts: list[str]) -> Node:
        value = float(parts[0])
        if not math.isfinite(value):
            raise ValueError(f"number {parts[0]} is too large")
        return Constant(value)

    def column(self, parts: list[str]) -> Node:
        return Column(str(parts[0]))

    def arithmetic(self, parts: list[Any]) -> Node:
        left, sign, right = parts
        return _low(Arithmetic(str(sign), _number(left), _number(right)))

    def negative(self, parts: list[Any]) -> Node:
        return _low(Unary("negative", _number(parts[1])))

    def size(self, parts: list[Any]) -> Node:
        return _low(Unary("abs", _number(parts[0])))

    def more(self, parts: list[Any]) -> Node:
        return _low(AtLeast(_number(parts[0]), _number(parts[2])))

    def less(self, parts: list[Any]) -> Node:
        return _low(AtLeast(_number(parts[2]), _number(parts[0])))

    def opposite(self, parts: list[Any]) -> Node:
        return _low(Not(_condition(parts[0])))

    def both(self, parts: list[Any]) -> Node:
        return _low(Both(_condition(parts[0]), _condition(parts[1]), either=False))

    def either(self, parts: list[Any]) -> Node:
        return _low(Both(_condition(parts[0]), _condition(parts[1]), either=True))

    def implies(self, parts: list[Any]) -> Node:
        return _low(Both(Not(_condition(parts[0])), _condition(parts[1]), either=True))

    def interval(self, parts: list[str]) -> tuple[int, int]:
        begin, end = float(parts[0]), float(parts[1])
        if not begin <= end <= SECONDS_MAX:
            allowed = f"allowed: 0 <= begin <= end <= {SECONDS_MAX:g}, in seconds"
            raise ValueError(f"interval [{parts[0]}, {parts[1]}]; {allowed}")
        return round(begin * 1e9), round(end * 1e9)

    def always(self, parts: list[Any]) -> Node:
        return _low(Over(_condition(parts[-1]), False, *_bounds(parts)))

    def eventually(self, parts: list[Any]) -> Node:
        return _low(Over(_condition(parts[-1]), True, *_bounds(parts)))

    def until(self, parts: list[Any]) -> Node:
        bounds = _bounds(parts[1:])
        return _low(Until(_condition(parts[0]), _condition(parts[-1]), *bounds))


def _bounds(parts: list[Any]) -> tuple[int, int | None]:
    """The interval before the last part, or the whole case."""
    return parts[0] if len(parts) == 2 else (0, None)


def _low(node: Node) -> Node:
    """The node, if it is not too tall."""
    level: list[Node] = [node]
    for _ in range(DEPTH_MAX):
        level = [part for above in level for part in parts_of(above)]
        if not level:
            return node
    raise ValueError(f"more than {DEPTH_MAX} operators inside each other")


def _number(node: Any) -> Any:
    if not isinstance(node, NUMBERS):
        raise ValueError("a condition stands where a number is needed; are brackets missing?")
    return node


def _condition(node: Any) -> Any:
    if isinstance(node, NUMBERS):
        what = f"'{node.name}'" if isinstance(node, Column) else "a number"
        raise ValueError(f"{what} has no bound; compare it, as in 'ttc_s > 1.0'")
    return node
