"""Where the fields of a record lie in the pools of floats and integers that kernels read.

The columns come from the records' own fields, so what is packed and what a kernel reads are one
declaration: kernels name columns by :func:`real_column` and :func:`whole_column`, which fail when a
field is renamed, and :func:`flatten` writes the same columns.
"""

from __future__ import annotations

import types
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from typing import Any, Union, get_args, get_origin, get_type_hints

from msgspec.structs import fields

from twin.scenario.storyboard.program.places import FixedPosition, Position, RelativePosition
from twin.scenario.storyboard.program.record import ProgramRecord

PLACE_REALS = ("x_m", "y_m", "z_m", "heading_rad", "pitch_rad", "roll_rad", "s_m", "t_m", "offset")
"""Floats of a position; those of a relative one begin with a, b, c."""
PLACE_WHOLES = ("frame", "entity", "road", "lane", "lanes", "relative", "by_road")
"""Integers of a position; frame -1: fixed, -2: there is none."""
FIXED_FRAME = -1
NO_PLACE = -2
TAIL = "tail"
"""Column of how many values of a row of any length stand behind a record's columns; rows stand in
the order of their fields."""

_POSITIONS = (Position, Position | None)


@dataclass(frozen=True, slots=True)
class RecordLayout:
    """Columns of a record, by dotted names of fields."""

    reals: tuple[str, ...]
    wholes: tuple[str, ...]


@cache
def layout_of(record: type) -> RecordLayout:
    """The columns of a record type."""
    reals: list[str] = []
    wholes: list[str] = []
    for name, kind in _leaves(record, ""):
        (reals if kind is float else wholes).append(name)
    return RecordLayout(tuple(reals), tuple(wholes))


def real_column(record: type, name: str) -> int:
    """Index of a float field among the floats of its record."""
    return layout_of(record).reals.index(name)


def whole_column(record: type, name: str) -> int:
    """Index of an integer field among the integers of its record."""
    return layout_of(record).wholes.index(name)


def flatten(record: Any) -> tuple[list[float], list[int]]:
    """A record's floats and integers in the order of :func:`layout_of`, tail values behind them."""
    reals: list[float] = []
    wholes: list[int] = []
    tail: list[Any] = []
    for name, kind in _leaves(type(record), ""):
        value = _value(record, name)
        if kind is tuple:
            tail += value
            wholes.append(len(value))
        elif kind is float:
            reals.append(float(value))
        else:
            wholes.append(-1 if value is None else int(value))
    for entry in tail:
        if isinstance(entry, ProgramRecord):
            more_reals, more_wholes = flatten(entry)
            reals += more_reals
            wholes += more_wholes
        else:
            wholes.append(int(entry))
    return reals, wholes


def _leaves(record: type, prefix: str) -> Iterator[tuple[str, type]]:
    hints = get_type_hints(record)
    for field in fields(record):
        hint = hints[field.name]
        name = prefix + field.name
        if hint in _POSITIONS:
            yield from ((f"{name}.{column}", float) for column in PLACE_REALS)
            yield from ((f"{name}.{column}", int) for column in PLACE_WHOLES)
        elif get_origin(hint) is tuple:
            yield f"{name}.{TAIL}", tuple
        elif isinstance(hint, type) and issubclass(hint, ProgramRecord):
            yield from _leaves(hint, name + ".")
        elif hint is float:
            yield name, float
        elif _is_whole(hint):
            yield name, int
        elif hint is not str:
            raise TypeError(f"{record.__name__}.{name}: no columns for {hint}")


def _is_whole(hint: Any) -> bool:
    if get_origin(hint) in (Union, types.UnionType):
        return all(part is type(None) or _is_whole(part) for part in get_args(hint))
    return isinstance(hint, type) and issubclass(hint, int | IntEnum)


def _value(record: Any, name: str) -> Any:
    head, _, rest = name.partition(".")
    value = getattr(record, head)
    if not rest or rest == TAIL:
        return value
    if value is None or isinstance(value, FixedPosition | RelativePosition):
        return _place_value(value, rest)
    return _value(value, rest)


def _place_value(place: Position | None, column: str) -> float:
    if place is None:
        return NO_PLACE if column == "frame" else 0
    if isinstance(place, FixedPosition):
        values: dict[str, float] = {
            "x_m": place.x_m,
            "y_m": place.y_m,
            "z_m": place.z_m,
            "s_m": place.s_m,
            "t_m": place.t_m,
            "offset": place.lane_offset_m,
            "frame": FIXED_FRAME,
            "entity": -1,
            "road": place.road,
            "lane": place.lane,
        }
    else:
        values = {
            "x_m": place.a,
            "y_m": place.b,
            "z_m": place.c,
            "frame": place.frame,
            "entity": place.entity,
            "lanes": place.lanes,
            "relative": int(place.relative_orientation),
            "by_road": int(place.by_road),
        }
    values |= {
        "heading_rad": place.heading_rad,
        "pitch_rad": place.pitch_rad,
        "roll_rad": place.roll_rad,
    }
    return values.get(column, 0)
