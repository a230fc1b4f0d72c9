"""What a parser may answer: declared field by field, packed by the child, checked by the parent.

An answer is a tree of lists, texts and numbers, in which arrays are numbers of a table beside it.
Nothing of it is code, and nothing is believed: who unpacks it knows by the declaration which types,
shapes and ranges may stand where. A field that a dataclass gains is a row of its :class:`Record`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np


class AnswerError(ValueError):
    """An answer that is not as declared; half a line, which names the field."""


@dataclass(frozen=True, slots=True)
class Array:
    """An array of finite numbers."""

    dtype: str
    shape: tuple[int | str, ...]
    """Sizes. A name stands for any size; the same one for all arrays of a record if it is in
    capitals."""
    optional: bool = False
    below: str = ""
    """Values are whole numbers from 0 to below the size of this name: indices."""
    side_min: int = 0
    side_max: int = 1 << 40
    """Smallest and largest size along any axis that has a name."""


@dataclass(frozen=True, slots=True)
class Number:
    """A finite number."""

    low: float = -math.inf
    high: float = math.inf
    whole: bool = False
    optional: bool = False


@dataclass(frozen=True, slots=True)
class Text:
    """A text; escaped where it is shown."""

    chars_max: int = 500
    allowed: tuple[str, ...] = ()
    """Empty: any."""
    optional: bool = False


@dataclass(frozen=True, slots=True)
class Flag:
    """True or false."""

    optional: bool = False


@dataclass(frozen=True, slots=True)
class ListOf:
    """A list; a tuple where ``as_tuple``."""

    each: Check
    most: int
    least: int = 0
    as_tuple: bool = False
    optional: bool = False


@dataclass(frozen=True, slots=True)
class Record:
    """A dataclass, with a declaration for each of its fields."""

    made: type[Any]
    rows: Mapping[str, Check]
    optional: bool = False


Check = Array | Number | Text | Flag | ListOf | Record
"""A declaration."""


@dataclass(slots=True)
class _Tables:
    """Arrays of an answer; one that stands in several places is the same object everywhere."""

    arrays: list[np.ndarray] = field(default_factory=list)
    numbers: dict[int, int] = field(default_factory=dict)

    def number(self, array: np.ndarray) -> int:
        if id(array) not in self.numbers:
            self.numbers[id(array)] = len(self.arrays)
            self.arrays.append(array)
        return self.numbers[id(array)]


def pack(value: Any, check: Check) -> tuple[Any, list[np.ndarray]]:
    """The tree of a value, and its arrays.

    Raises:
        AssertionError: the declaration does not fit the type: a bug of ours.
    """
    tables = _Tables()
    return _packed(value, check, tables), tables.arrays


def _packed(value: Any, check: Check, tables: _Tables) -> Any:
    if value is None:
        return None
    if isinstance(check, Array):
        return tables.number(value)
    if isinstance(check, ListOf):
        return [_packed(item, check.each, tables) for item in value]
    if isinstance(check, Record):
        names = {each.name for each in fields(check.made)}
        assert names == set(check.rows), (
            f"{check.made.__name__}: fields without a check, or checks without a field: "
            f"{sorted(names ^ set(check.rows))}"
        )
        return {
            name: _packed(getattr(value, name), row, tables) for name, row in check.rows.items()
        }
    return value.item() if isinstance(value, np.generic) else value


def unpack(tree: Any, check: Check, arrays: list[np.ndarray]) -> Any:
    """What was packed, if it is as declared.

    Raises:
        AnswerError: it is not.
    """
    return _Unpacking(arrays).value(tree, check, "answer", {})


@dataclass(slots=True)
class _Unpacking:
    arrays: list[np.ndarray]
    finite: set[int] = field(default_factory=set)
    """Numbers of arrays that have been looked through."""

    def value(self, tree: Any, check: Check, name: str, sizes: dict[str, int]) -> Any:
        if tree is None:
            if check.optional:
                return None
            raise AnswerError(f"{name} is missing")
        if isinstance(check, Record):
            return self._record(tree, check, name)
        if isinstance(check, ListOf):
            return self._list(tree, check, name, sizes)
        if isinstance(check, Array):
            return self._array(tree, check, name, sizes)
        if not _is_plain(tree, check):
            raise AnswerError(f"{name} is not as declared")
        return tree

    def _record(self, tree: Any, check: Record, name: str) -> Any:
        if not isinstance(tree, dict) or set(tree) != set(check.rows):
            raise AnswerError(f"{name} has other fields")
        sizes: dict[str, int] = {}
        # Indices are compared with sizes that other arrays give.
        last = sorted(check.rows, key=lambda key: bool(getattr(check.rows[key], "below", "")))
        values = {key: self.value(tree[key], check.rows[key], key, sizes) for key in last}
        return check.made(**values)

    def _list(self, tree: Any, check: ListOf, name: str, sizes: dict[str, int]) -> Any:
        if not isinstance(tree, list) or not check.least <= len(tree) <= check.most:
            raise AnswerError(f"{name} is no list of {check.least} to {check.most}")
        found = [self.value(item, check.each, name, sizes) for item in tree]
        return tuple(found) if check.as_tuple else found

    def _array(self, tree: Any, check: Array, name: str, sizes: dict[str, int]) -> np.ndarray:
        if isinstance(tree, bool) or not isinstance(tree, int) or not 0 <= tree < len(self.arrays):
            raise AnswerError(f"{name} names an array that is not there")
        found = self.arrays[tree]
        shown = f"{name} of type {found.dtype}, shape {list(found.shape)}"
        if found.dtype != check.dtype or found.ndim != len(check.shape):
            raise AnswerError(f"{shown}: not as declared")
        for size, axis in zip(found.shape, check.shape, strict=True):
            shared = isinstance(axis, str) and axis.isupper()
            wanted = sizes.setdefault(str(axis), size) if shared else axis
            fits = size == wanted if isinstance(wanted, int) else True
            free = isinstance(axis, int) or check.side_min <= size <= check.side_max
            if not fits or not free:
                raise AnswerError(f"{shown}: not as declared")
        if found.dtype.kind == "f" and tree not in self.finite:
            if not np.isfinite(found).all():
                raise AnswerError(f"{name} holds NaN or infinite numbers")
            self.finite.add(tree)
        indices = bool(check.below) and found.size > 0
        if indices and (found.min() < 0 or found.max() >= sizes[check.below]):
            raise AnswerError(f"{name} names what is not there")
        return found


def _is_plain(tree: Any, check: Check) -> bool:
    if isinstance(check, Flag):
        return isinstance(tree, bool)
    if isinstance(check, Text):
        fits = isinstance(tree, str) and len(tree) <= check.chars_max
        return fits and (not check.allowed or tree in check.allowed)
    assert isinstance(check, Number)
    if isinstance(tree, bool) or not isinstance(tree, int if check.whole else int | float):
        return False
    return check.low <= tree <= check.high and abs(tree) < math.inf
