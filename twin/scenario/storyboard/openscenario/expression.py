"""Expressions of OpenSCENARIO XML (``${...}``), evaluated by a parser of their own.

Numbers are float64 and booleans stay booleans. By rising strength: ``or``, ``and``, ``not``,
comparisons, ``+ -``, ``* / %``, sign, ``**``. ``%`` is the remainder with the sign of the dividend,
``round`` goes away from zero at one half.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping

Number = float | bool
Value = float | int | bool | str

DEPTH_MAX = 50
"""How deep an expression may nest."""
CHARS_MAX = 10_000
"""Longest expression [characters]."""

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<parameter>\$[A-Za-z_]\w*)"
    r"|(?P<name>[A-Za-z_]\w*)|(?P<sign>\*\*|<=|>=|==|!=|&&|\|\||[-+*/%()<>,!^]))"
)


def _round(x: float) -> float:
    return math.copysign(math.floor(abs(x) + 0.5), x)


def _sign(x: float) -> float:
    return float((x > 0) - (x < 0))


_FUNCTIONS: dict[str, tuple[int, Callable[..., float]]] = {
    "round": (1, _round),
    "floor": (1, math.floor),
    "ceil": (1, math.ceil),
    "sqrt": (1, math.sqrt),
    "pow": (2, math.pow),
    "sign": (1, _sign),
    "abs": (1, abs),
    "min": (2, min),
    "max": (2, max),
    "sin": (1, math.sin),
    "cos": (1, math.cos),
    "tan": (1, math.tan),
    "asin": (1, math.asin),
    "acos": (1, math.acos),
    "atan": (1, math.atan),
}
_CONSTANTS: dict[str, Number] = {"pi": math.pi, "e": math.e, "true": True, "false": False}
_COMPARISONS: dict[str, Callable[[Number, Number], bool]] = {
    "==": lambda a, b: a == b,
    "!=": lambda a, b: a != b,
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
}


def evaluate(text: str, parameters: Mapping[str, Value]) -> Number:
    """The value of an expression, without its ``${`` and ``}``.

    Args:
        text: the expression.
        parameters: values by name, without ``$``.

    Raises:
        ValueError: what is wrong with it, in one line.
    """
    if len(text) > CHARS_MAX:
        raise ValueError(f"the expression has more than {CHARS_MAX} characters")
    parser = _Parser(text, parameters)
    try:
        value = parser.disjunction()
    except OverflowError:
        raise ValueError(f"'{text}' is too large a number") from None
    if parser.at < len(parser.tokens):
        raise ValueError(f"'{parser.tokens[parser.at]}' in '{text}' is one too many")
    if not isinstance(value, bool) and not math.isfinite(value):
        raise ValueError(f"'{text}' is not a finite number")
    return value


class _Parser:
    """Recursive descent; one method per strength."""

    def __init__(self, text: str, parameters: Mapping[str, Value]) -> None:
        self.text = text
        self.parameters = parameters
        self.tokens: list[str] = []
        self.at = 0
        self.depth = 0
        end = 0
        stripped = text.rstrip()
        while end < len(stripped):
            match = _TOKEN.match(stripped, end)
            if not match:
                raise ValueError(f"'{stripped[end:].strip()[:20]}' in '{text}' is no expression")
            self.tokens.append(match[0].strip())
            end = match.end()

    def take(self, *options: str) -> str:
        """The next token if it is one of ``options``, otherwise nothing."""
        if self.at < len(self.tokens) and self.tokens[self.at] in options:
            self.at += 1
            return self.tokens[self.at - 1]
        return ""

    def disjunction(self) -> Number:
        value = self.conjunction()
        while self.take("or", "||"):
            right = self._boolean(self.conjunction())
            value = self._boolean(value) or right
        return value

    def conjunction(self) -> Number:
        value = self.negation()
        while self.take("and", "&&"):
            right = self._boolean(self.negation())
            value = self._boolean(value) and right
        return value

    def negation(self) -> Number:
        self._deeper()
        value: Number
        if self.take("not", "!"):
            value = not self._boolean(self.negation())
        else:
            value = self.comparison()
        self.depth -= 1
        return value

    def comparison(self) -> Number:
        value = self.sum()
        if operator := self.take(*_COMPARISONS):
            return _COMPARISONS[operator](value, self.sum())
        return value

    def sum(self) -> Number:
        value = self.product()
        while operator := self.take("+", "-"):
            left, right = self._number(value), self._number(self.product())
            value = left + right if operator == "+" else left - right
        return value

    def product(self) -> Number:
        value = self.signed()
        while operator := self.take("*", "/", "%"):
            left, right = self._number(value), self._number(self.signed())
            if operator == "*":
                value = left * right
            elif right == 0.0:
                raise ValueError(f"'{self.text}' divides by zero")
            else:
                value = left / right if operator == "/" else math.fmod(left, right)
        return value

    def signed(self) -> Number:
        self._deeper()
        value: Number
        if operator := self.take("+", "-"):
            number = self._number(self.signed())
            value = -number if operator == "-" else number
        else:
            value = self.power()
        self.depth -= 1
        return value

    def power(self) -> Number:
        value = self.atom()
        if self.take("**", "^"):
            return self._call("pow", math.pow, [self._number(value), self._number(self.signed())])
        return value

    def atom(self) -> Number:
        if self.at >= len(self.tokens):
            raise ValueError(f"'{self.text}' ends too early")
        token = self.tokens[self.at]
        self.at += 1
        if token == "(":
            value = self.disjunction()
            self._expect(")")
            return value
        if token.startswith("$"):
            return self._parameter(token[1:])
        if token[0].isdigit() or token[0] == ".":
            return float(token)
        if token in _CONSTANTS:
            return _CONSTANTS[token]
        if token in _FUNCTIONS:
            return self._function(token)
        known = ", ".join([*_FUNCTIONS, *_CONSTANTS])
        raise ValueError(f"'{token}' in '{self.text}' is not known; known are {known}")

    def _function(self, name: str) -> float:
        count, function = _FUNCTIONS[name]
        self._expect("(")
        values = [self._number(self.disjunction())]
        while self.take(","):
            values.append(self._number(self.disjunction()))
        self._expect(")")
        if len(values) != count:
            raise ValueError(f"{name} in '{self.text}' takes {count} values, not {len(values)}")
        return self._call(name, function, values)

    def _call(self, name: str, function: Callable[..., float], values: list[float]) -> float:
        try:
            return float(function(*values))
        except ValueError:
            numbers = ", ".join(f"{value:g}" for value in values)
            raise ValueError(f"{name}({numbers}) in '{self.text}' has no value") from None

    def _parameter(self, name: str) -> Number:
        if name not in self.parameters:
            raise ValueError(f"parameter ${name} in '{self.text}' is not declared here")
        value = self.parameters[name]
        if isinstance(value, str):
            raise ValueError(f"parameter ${name} in '{self.text}' is the string '{value}'")
        return value if isinstance(value, bool) else float(value)

    def _expect(self, token: str) -> None:
        if not self.take(token):
            raise ValueError(f"'{token}' is missing in '{self.text}'")

    def _deeper(self) -> None:
        self.depth += 1
        if self.depth > DEPTH_MAX:
            raise ValueError(f"the expression nests deeper than {DEPTH_MAX}")

    def _number(self, value: Number) -> float:
        if isinstance(value, bool):
            raise ValueError(f"a boolean stands where a number must be in '{self.text}'")
        return value

    def _boolean(self, value: Number) -> bool:
        if not isinstance(value, bool):
            raise ValueError(f"a number stands where a boolean must be in '{self.text}'")
        return value
