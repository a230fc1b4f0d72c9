"""Attribute values of OpenSCENARIO XML: literals, parameters and expressions, by type."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from datetime import datetime

from twin.scenario.storyboard.openscenario.expression import Value, evaluate
from twin.scenario.storyboard.openscenario.standard import enumerations

PARAMETER_TYPES = {
    "boolean": "b",
    "dateTime": "t",
    "double": "d",
    "int": "i",
    "integer": "i",
    "string": "s",
    "unsignedInt": "u",
    "unsignedShort": "h",
}
"""Short type of every type that a parameter may be declared with."""
_WORDS = {short: name for name, short in PARAMETER_TYPES.items()}
_INTEGERS = {"i": (-(2**31), 2**31 - 1), "u": (0, 2**32 - 1), "h": (0, 2**16 - 1)}
_DOUBLE = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$")
_NAME = re.compile(r"\$[A-Za-z_]\w*$")
TEXT_CHARS_MAX = 10_000
"""Longest value [characters]."""


def value_of(text: str, type_name: str, parameters: Mapping[str, Value], minor: int) -> Value:
    """The value of an attribute.

    Args:
        text: as it stands in the file.
        type_name: ``s d i u h b t`` or the name of an enumeration.
        parameters: values of the parameters in scope, by name.
        minor: minor version of the file.

    Raises:
        ValueError: what is wrong with it, in one line.
    """
    if len(text) > TEXT_CHARS_MAX:
        raise ValueError(f"a value of more than {TEXT_CHARS_MAX} characters")
    plain = text.strip()
    if plain.startswith("${"):
        if not plain.endswith("}"):
            raise ValueError(f"'{plain}' has no closing brace")
        return convert(evaluate(plain[2:-1], parameters), type_name, minor)
    if _NAME.match(plain):
        name = plain[1:]
        if name not in parameters:
            raise ValueError(f"parameter {plain} is not declared here{_near(name, parameters)}")
        return convert(parameters[name], type_name, minor)
    if plain.startswith("$"):
        raise ValueError(f"'{plain}' is neither a parameter ($name) nor an expression (${{...}})")
    return convert(text if type_name == "s" else plain, type_name, minor)


def convert(value: Value, type_name: str, minor: int) -> Value:
    """A value as ``type_name``; raises ValueError as :func:`value_of`."""
    if type_name == "s":
        return value if isinstance(value, str) else written(value)
    if type_name == "d":
        return _double(value)
    if type_name in _INTEGERS:
        return _integer(value, type_name)
    if type_name == "b":
        if isinstance(value, bool):
            return value
        if value in ("true", "1", 1):
            return True
        if value in ("false", "0", 0):
            return False
        raise ValueError(f"'{_shown(value)}' is no boolean; true or false")
    if type_name == "t":
        return _date_time(value)
    return _member(value, type_name, minor)


def written(value: Value) -> str:
    """A value as it would stand in a file."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        if math.isinf(value):
            return "INF" if value > 0 else "-INF"
        return str(int(value)) if value.is_integer() and abs(value) < 2**53 else repr(value)
    return str(value)


def _double(value: Value) -> float:
    if isinstance(value, str):
        text = value.strip()
        if text in ("INF", "+INF", "-INF"):
            return -math.inf if text[0] == "-" else math.inf
        if text == "NaN":
            raise ValueError("NaN is no value that a scenario can use; give a number")
        if not _DOUBLE.match(text):
            raise ValueError(f"'{_shown(value)}' is no number")
        number = float(text)
        if math.isinf(number):
            raise ValueError(f"'{_shown(value)}' is too large a number")
        return number
    if isinstance(value, bool):
        raise ValueError(f"{written(value)} is no number")
    return float(value)


def _integer(value: Value, type_name: str) -> int:
    number = _double(value)
    least, most = _INTEGERS[type_name]
    if not number.is_integer():
        raise ValueError(f"'{_shown(value)}' is no integer")
    if not least <= number <= most:
        raise ValueError(f"'{_shown(value)}' is outside {least} to {most} ({_WORDS[type_name]})")
    return int(number)


def _date_time(value: Value) -> str:
    try:
        return datetime.fromisoformat(str(value)).isoformat()
    except ValueError:
        raise ValueError(
            f"'{_shown(value)}' is no date and time; write it as 2026-01-31T12:00:00"
        ) from None


def _member(value: Value, type_name: str, minor: int) -> str:
    members = enumerations()[type_name]
    word = str(value)
    if word not in members:
        raise ValueError(f"'{_shown(value)}' is none of {', '.join(members)}")
    if members[word] > minor:
        raise ValueError(f"'{word}' is since version 1.{members[word]}, this file says 1.{minor}")
    return word


def _near(name: str, parameters: Mapping[str, Value]) -> str:
    same = [other for other in parameters if other.lower() == name.lower()]
    return f"; is it ${same[0]}?" if same else ""


def _shown(value: Value) -> str:
    text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."
