"""Elements of a scenario as they were read: typed values, children, and where they stand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from twin.scenario.storyboard.openscenario.expression import Value

MISTAKES_MAX = 100
"""Mistakes of one scenario that are told."""


@dataclass(frozen=True, slots=True)
class ScenarioElement:
    """One element, of a scenario or of a catalog that it uses.

    Values are float (``d``), int, bool or str; parameters and expressions in them are resolved.
    """

    name: str
    """As it stands in the file."""
    type_name: str
    """Key of :func:`.standard.element_rules`."""
    values: Mapping[str, Value]
    """Attributes; optional ones that are not given are missing."""
    children: tuple[ScenarioElement, ...]
    text: str
    file: Path
    line: int
    target: ScenarioElement | None = None
    """Of a catalog reference: the entry, with its parameters assigned."""

    def all(self, *names: str) -> list[ScenarioElement]:
        """Children of these names, in order."""
        return [child for child in self.children if child.name in names]

    def first(self, name: str) -> ScenarioElement | None:
        """The first child of a name."""
        return next((child for child in self.children if child.name == name), None)

    def walk(self) -> Iterator[ScenarioElement]:
        """The element and everything below it, in order; entries of catalogs stand in the place
        of their references."""
        yield self
        for child in (*self.children, *([self.target] if self.target else [])):
            yield from child.walk()

    @property
    def label(self) -> str:
        """Value of ``name``, empty if there is none."""
        return str(self.values.get("name", ""))


@dataclass(slots=True)
class ScenarioMistakes:
    """Everything that is wrong with a scenario, in the order in which it was met."""

    lines: list[str] = field(default_factory=list)

    def add(self, file: Path, line: int, words: str) -> None:
        """Note a mistake, each once."""
        text = f"{file}:{line}: {' '.join(words.split())}"
        if text not in self.lines and len(self.lines) <= MISTAKES_MAX:
            self.lines.append(text)

    @property
    def full(self) -> bool:
        """No more are told."""
        return len(self.lines) > MISTAKES_MAX

    def check(self) -> None:
        """Raises ValueError with a line per mistake, if there is any."""
        if self.full:
            raise ValueError(
                "\n".join([*self.lines[:MISTAKES_MAX], "and more; correct these first"])
            )
        if self.lines:
            raise ValueError("\n".join(self.lines))
