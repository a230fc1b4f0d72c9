"""Scenario files: reading them, and their numbers by path."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec

from schemas.files.yaml_file import load_yaml
from schemas.validation import Mistake, convert_all, suggest
from twin.scenario.storyboard.native.sections import NativeScenario

SUFFIX = ".yaml"
SHIPPED = Path(__file__).parents[1] / "shipped"
"""Folder of the scenarios that ship."""
_MPS, _KMH = "_mps", "_kmh"


@dataclass(frozen=True, slots=True)
class NativeDocument:
    """A scenario file that was read."""

    file: Path
    """Roads are relative to its folder."""
    scenario: NativeScenario


def shipped_scenarios(*, of_rulebooks: bool = True) -> tuple[str, ...]:
    """Names of the shipped scenarios; ``of_rulebooks``: those of rulebooks, too."""
    files = _shipped_files().items()
    return tuple(sorted(n for n, path in files if of_rulebooks or path.parent == SHIPPED))


def _shipped_files() -> dict[str, Path]:
    """Files of the shipped scenarios by name; those of a rulebook have a folder of their own."""
    return {path.stem: path for path in SHIPPED.rglob(f"*{SUFFIX}")}


def is_native(name_or_path: str) -> bool:
    """Whether it is the name of a scenario, shipped or not, or the path of a scenario file."""
    return Path(name_or_path).suffix in (SUFFIX, ".yml", "")


def scenario_path(name_or_path: str) -> Path:
    """The file of a shipped scenario, or a path as it is.

    Raises:
        ValueError: no scenario of this name is shipped.
    """
    if name_or_path in (shipped := _shipped_files()):
        return shipped[name_or_path]
    path = Path(name_or_path)
    if path.suffix in (SUFFIX, ".yml"):
        return path
    names = suggest(name_or_path, list(shipped_scenarios()))
    raise ValueError(f"scenario '{name_or_path}' is not shipped; {names}, or the path of a .yaml")


def load_native(name_or_path: str | Path) -> NativeDocument:
    """A shipped scenario by name, or a scenario file.

    Raises:
        ValueError: it cannot be read, or has mistakes; a line for each with file and path.
    """
    path = scenario_path(str(name_or_path))
    return _document(path, load_yaml(path))


def _document(path: Path, data: Any) -> NativeDocument:
    scenario, mistakes = convert_all(data, NativeScenario)
    if scenario is None:
        raise_mistakes(path, mistakes)
    assert scenario is not None
    return NativeDocument(path, scenario)


def raise_mistakes(path: Path, mistakes: list[Mistake]) -> None:
    """Raises ValueError with a line per mistake, if there is any."""
    if mistakes:
        raise ValueError("\n".join(mistake.line(str(path)) for mistake in mistakes))


def numbers_of(document: NativeDocument) -> dict[str, float]:
    """Every number of a scenario by its path, such as ``actors.van.ahead_m``.

    Numbers that the file leaves out stand with their defaults; those without a default are left
    out. Entries of lists are counted from 0: ``events.cross.do.walker.path.1.0``.
    """
    numbers: dict[str, float] = {}
    _collect(msgspec.to_builtins(document.scenario), "", numbers)
    return numbers


def _collect(value: Any, path: str, numbers: dict[str, float]) -> None:
    if isinstance(value, dict | list):
        entries = value.items() if isinstance(value, dict) else enumerate(value)
        for key, entry in entries:
            _collect(entry, f"{path}.{key}" if path else str(key), numbers)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        numbers[path] = value


def with_values(document: NativeDocument, values: Mapping[str, float]) -> NativeDocument:
    """The same scenario with other numbers.

    Args:
        document: what is varied.
        values: numbers by path, as :func:`numbers_of` names them; speeds also in km/h, with
            ``_kmh`` in place of ``_mps``.

    Raises:
        ValueError: a path is none of a number, or a number is out of range; a line for each.
    """
    data = msgspec.to_builtins(document.scenario)
    allowed = numbers_of(document)
    values = dict(_in_units_of(allowed, values))
    mistakes = [
        Mistake(path, f"no number of this scenario; {suggest(path, _nearest(path, allowed))}")
        for path in values
        if path not in allowed
    ]
    raise_mistakes(document.file, mistakes)
    for path, value in values.items():
        *parents, last = path.split(".")
        place = data
        for key in parents:
            place = place[int(key)] if isinstance(place, list) else place[key]
        whole = isinstance(allowed[path], int) and float(value).is_integer()
        place[int(last) if isinstance(place, list) else last] = int(value) if whole else value
    return replace(document, scenario=_document(document.file, data).scenario)


def _in_units_of(
    allowed: Mapping[str, float], values: Mapping[str, float]
) -> Iterator[tuple[str, float]]:
    """Numbers as the file has them: a speed may be given in km/h, as ``ego.speed_kmh`` for
    ``ego.speed_mps``."""
    for path, value in values.items():
        stem = path.removesuffix(_KMH)
        if path not in allowed and stem != path and stem + _MPS in allowed:
            yield stem + _MPS, value / 3.6
        else:
            yield path, value


def _nearest(path: str, allowed: Mapping[str, float]) -> list[str]:
    """Paths that begin alike, as long as there are some; else all."""
    parts = path.split(".")
    for count in range(len(parts) - 1, 0, -1):
        begin = ".".join(parts[:count]) + "."
        alike = [name for name in allowed if name.startswith(begin)]
        if alike:
            return alike
    return list(allowed)
