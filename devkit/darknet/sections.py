"""The text of a Darknet ``.cfg``: sections of ``key=value`` lines, and typed access to them.

A key nobody knows is an error: a layer that silently does something else than in Darknet would be
found in the boxes only, if at all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from schemas.files.regular_file import open_regular
from schemas.validation import suggest
from twin.base.errors import UsageError

TEXT_BYTES_MAX = 1 << 20
"""A larger file is not a cfg [bytes]; the largest published ones have 40 kB."""

T = TypeVar("T")


class DarknetError(UsageError):
    """A Darknet file cannot be used; one line naming file and place."""


@dataclass(frozen=True, slots=True)
class Option:
    """The text right of ``=``, without blanks, and its line (from 1)."""

    text: str
    line: int


@dataclass(frozen=True, slots=True)
class CfgSection:
    """One ``[name]`` and its options in the order of the file."""

    name: str
    line: int
    options: Mapping[str, Option]


def read_sections(path: Path) -> list[CfgSection]:
    """Sections of a cfg file.

    Raises:
        DarknetError: the file cannot be read or is no cfg.
    """
    try:
        with open_regular(path) as stream:
            data = stream.read(TEXT_BYTES_MAX + 1)
    except OSError as error:
        raise DarknetError(f"{path}: {error.strerror or error}") from None
    try:
        text = data.decode()
    except UnicodeDecodeError:
        text = "\0"
    if len(data) > TEXT_BYTES_MAX or "\0" in text:
        raise DarknetError(f"{path}: not a Darknet cfg (text of sections like [net]); wrong file?")
    return parse_sections(text, str(path))


def parse_sections(text: str, name: str) -> list[CfgSection]:
    """Sections of a cfg's ``text``; ``name`` is the file in error messages.

    As in Darknet, blanks mean nothing and lines that begin with ``#`` or ``;`` are comments; a
    ``#`` or ``;`` behind a value begins a comment too.
    """
    sections: list[CfgSection] = []
    options: dict[str, Option] = {}
    for number, raw in enumerate(text.splitlines(), 1):
        line = "".join(raw.split("#")[0].split(";")[0].split())
        if not line:
            continue
        if line.startswith("["):
            if not line.endswith("]") or len(line) < 3:
                raise DarknetError(f"{name}:{number}: given '{line[:40]}', expected [section]")
            options = {}
            sections.append(CfgSection(line[1:-1].lower(), number, options))
            continue
        key, equals, value = line.partition("=")
        if not (key and equals and value):
            raise DarknetError(f"{name}:{number}: given '{line[:40]}', expected key=value")
        if not sections:
            raise DarknetError(f"{name}:{number}: '{key}' before the first section, e.g. [net]")
        if key in options:
            first = options[key].line
            raise DarknetError(f"{name}:{number}: '{key}' again, first given in line {first}")
        options[key] = Option(value, number)
    if not sections:
        raise DarknetError(f"{name}: no sections; a cfg begins with [net]")
    return sections


def to_text(sections: Sequence[CfgSection]) -> str:
    """The sections as cfg text again, comments gone."""
    return "\n".join(
        f"[{section.name}]\n" + "".join(f"{k}={o.text}\n" for k, o in section.options.items())
        for section in sections
    )


class Reader:
    """Takes options out of a section one by one; :meth:`finish` refuses the ones left over."""

    def __init__(self, section: CfgSection, name: str) -> None:
        """``name`` is the file in error messages."""
        self._section = section
        self._name = name
        self._taken: list[str] = []

    def error(self, message: str, key: str = "") -> DarknetError:
        """The error about ``key`` or the whole section, with file and line."""
        option = self._section.options.get(key)
        line = option.line if option else self._section.line
        where = f"{self._name}:{line}: [{self._section.name}]"
        return DarknetError(f"{where} {key}: {message}" if key else f"{where} {message}")

    def integer(self, key: str, default: int | None, low: int = 0, high: int = 1 << 20) -> int:
        """A whole number from ``low`` to ``high``; needed if there is no default."""
        allowed = f"a whole number {low} to {high}"
        value = self._take(key, default, int, allowed)
        if not low <= value <= high:
            raise self.error(f"given {value}, allowed: {allowed}", key)
        return value

    def number(self, key: str, default: float) -> float:
        """A finite number."""
        return self._take(key, default, _finite, "a finite number")

    def flag(self, key: str, default: bool) -> bool:
        """0 or 1."""
        return bool(self.integer(key, int(default), 0, 1))

    def word(self, key: str, default: str, allowed: Collection[str]) -> str:
        """One of the ``allowed`` words."""
        value = self._take(key, default, str, "")
        if value not in allowed:
            raise self.error(f"given '{value}', {suggest(value, sorted(allowed))}", key)
        return value

    def integers(self, key: str, default: list[int] | None) -> list[int]:
        """Whole numbers, separated by commas."""
        return self._take(key, default, _list_of(int), "whole numbers separated by commas")

    def numbers(self, key: str, default: list[float] | None) -> list[float]:
        """Finite numbers, separated by commas."""
        return self._take(key, default, _list_of(_finite), "numbers separated by commas")

    def finish(
        self, ignored: Collection[str] = (), neutral: Mapping[str, float] | None = None
    ) -> None:
        """Refuse what was not taken.

        Args:
            ignored: keys that matter in training only.
            neutral: keys that are not supported, with the value at which they change nothing.
        """
        neutral = neutral or {}
        for key in self._section.options:
            if key in neutral:
                if self.number(key, 0.0) != neutral[key]:
                    text = self._section.options[key].text
                    raise self.error(f"given {text}, supported: {neutral[key]:g}", key)
            elif key not in self._taken and key not in ignored:
                known = sorted({*self._taken, *neutral})
                raise self.error(f"unknown key; {suggest(key, known)}", key)

    def _take(self, key: str, default: T | None, convert: Callable[[str], T], allowed: str) -> T:
        self._taken.append(key)
        option = self._section.options.get(key)
        if option is None:
            if default is None:
                raise self.error(f"'{key}' is missing; {allowed} needed")
            return default
        try:
            return convert(option.text)
        except ValueError:
            raise self.error(f"given '{option.text[:40]}', allowed: {allowed}", key) from None


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def _list_of(convert: Callable[[str], T]) -> Callable[[str], list[T]]:
    # A comma at the end is as good as none: several published files have one.
    return lambda text: [convert(part) for part in text.rstrip(",").split(",")]
