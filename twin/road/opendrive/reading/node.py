"""One element of a file: its attributes as checked values, its children by the vocabulary."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any, NoReturn

from schemas.escape import escape
from twin.road.opendrive.reading.vocabulary import rule_of

NUMBER_MAX = 1e9
"""Largest magnitude of a number; no length, curvature or coefficient of a road comes near it."""
TEXT_CHARS_MAX = 1000
"""Longest attribute that is kept [characters]."""
NOTES_MAX = 1000
"""Most notes of one file; further ones are counted."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_WHOLE = re.compile(r"[+-]?\d{1,9}")


@dataclass(slots=True)
class Notes:
    """What was left out of a file and may be missed, a line each."""

    lines: list[str]
    further: int = 0
    """How many more there were than are kept."""

    def add(self, line: str) -> None:
        """One more."""
        if len(self.lines) < NOTES_MAX:
            self.lines.append(line)
        else:
            self.further += 1


@dataclass(frozen=True, slots=True)
class Node:
    """An element, with the words for what is wrong with it."""

    element: Any
    name: str
    """Of the element, without a namespace."""
    parent: str
    """Name of the element it stands in."""
    file: str
    where: str
    """What it belongs to: ``road 3``, or nothing."""
    notes: Notes

    @property
    def line(self) -> int:
        """Where it begins in the file, from 1."""
        return int(self.element.sourceline or 0)

    def refuse(self, words: str) -> NoReturn:
        """End reading.

        Raises:
            ValueError: always; the file, line and element, and ``words``.
        """
        raise ValueError(self.message(words))

    def message(self, words: str) -> str:
        """``words`` behind the file, line and element."""
        place = f" of {self.where}" if self.where else ""
        return escape(f"{self.file}:{self.line}: <{self.name}>{place}: {words}", 600)

    def text(self, key: str, default: str | None = None) -> str:
        """An attribute as it stands; without ``default`` it is needed."""
        value = self.element.get(key)
        if value is None:
            if default is None:
                self.refuse(f"{key} is missing")
            return default
        if len(value) > TEXT_CHARS_MAX:
            self.refuse(f"{key} has {len(value)} characters, at most {TEXT_CHARS_MAX} are read")
        return str(value)

    def number(self, key: str, default: float | None = None, *, low: float = -NUMBER_MAX) -> float:
        """A finite number of at least ``low``; without ``default`` it is needed."""
        value = self.element.get(key)
        if value is None:
            if default is None:
                self.refuse(f"{key} is missing")
            return default
        words = value.strip()
        number = float(words) if len(words) < 100 and _NUMBER.fullmatch(words) else math.nan
        if not abs(number) <= NUMBER_MAX:
            self.refuse(f"{key}={value[:40]!r}; a number between -1e9 and 1e9 is needed")
        if number < low:
            self.refuse(f"{key}={value[:40]!r}; at least {low:g} is needed")
        return number + 0.0

    def whole(self, key: str) -> int:
        """A whole number."""
        value = self.text(key).strip()
        if not _WHOLE.fullmatch(value):
            self.refuse(f"{key}={value[:40]!r}; a whole number is needed")
        return int(value)

    def choice(self, key: str, allowed: Collection[str], default: str | None = None) -> str:
        """One of the words ``allowed``."""
        value = self.text(key, default)
        if value not in allowed:
            self.refuse(f"{key}={value[:40]!r}; one of {', '.join(sorted(allowed))} is needed")
        return value

    def flag(self, key: str, default: bool = False) -> bool:
        """``true`` or ``false``; 1 and 0 are understood."""
        words = {"true": True, "1": True, "false": False, "0": False}
        return words[self.choice(key, words, "true" if default else "false")]

    def children(self, where: str | None = None) -> Iterator[Node]:
        """Children that are read, in order; what is ignored is passed over, what is noted noted.

        Args:
            where: what they belong to; None: to the same as this element.

        Raises:
            ValueError: one is refused, or none of OpenDRIVE.
        """
        own = self.element.tag
        space = own[: own.index("}") + 1] if own.startswith("{") else ""
        path = f"{self.parent}/{self.name}"
        for element in self.element:
            if not isinstance(element.tag, str):
                continue
            name = element.tag.removeprefix(space) if space else element.tag
            place = self.where if where is None else where
            node = Node(element, name, self.name, self.file, place, self.notes)
            rule = rule_of(path, name)
            if rule is None:
                node.refuse(f"not known in <{self.name}> of OpenDRIVE 1.4 to 1.8")
            if rule.treatment == "refused":
                node.refuse(f"not supported: {rule.why}")
            if rule.treatment == "noted":
                self.notes.add(node.message(f"left out: {rule.why}"))
            elif rule.treatment == "read":
                yield node

    def only(self, name: str) -> Node | None:
        """The one child of that name, None if there is none."""
        same = [node for node in self.children() if node.name == name]
        if len(same) > 1:
            same[1].refuse(f"a second one in <{self.name}>, after line {same[0].line}")
        return same[0] if same else None
