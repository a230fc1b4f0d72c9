"""The campaign section ``rulebook``: rows of a test protocol, from which cases are made.

Every row is a test with its values, its repetitions and its criterion
(:class:`schemas.sections.trial.Trial`). How rows become cases: :mod:`schemas.rulebook_points`.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

from schemas.names import Name
from schemas.sections.trial import Pair, Trial

Rank = Literal["A", "B", "C"]
"""Rank of a source. A: official text; B: text or files of a third party; C: somebody's reading."""
REPETITIONS_MAX = 1000
"""Most runs of a point of a row."""

Number = int | float
Axis = bool | int | float | str


class _Section(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of the parts of a rulebook: frozen, unknown keys are errors."""


class RulebookTable(_Section, frozen=True, kw_only=True):
    """Table in which a report shows a group: numbers or axes of its rows."""

    x: str
    """Number or axis from left to right; `test` for the tests of the rows."""
    y: str = "test"
    """Number or axis from top to bottom; `test` for the tests of the rows."""


class RulebookGroup(_Section, frozen=True, kw_only=True):
    """Rows that a report shows together, and that pass together."""

    title: str
    """Heading of its table."""
    clause: str = ""
    """Clause of the source."""
    failures_max: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """Share of its conclusive runs that may fail [-]."""
    table: RulebookTable | None = None
    """Its table; not given: its rows, one below the other."""
    tags: list[Name] = []
    """Words by which commands choose its rows, as the range of a protocol that they belong to."""


class RulebookRow(_Section, frozen=True, kw_only=True):
    """One test of a protocol; its values from the easiest to the hardest."""

    row: Name
    """Name by which commands call it, with which the names of its cases begin."""
    test: str
    """Name of the test, as the source has it."""
    group: str = ""
    """Group that it belongs to."""
    clause: str = ""
    """Clause of the source."""
    rank: Rank | None = None
    """Rank of the source of its numbers, where it is another than the rulebook's."""
    note: str = ""
    """What a reader of its results must know."""
    storyboard: str = ""
    """Name of a shipped scenario, or the path of a scenario file; empty: that of the section
    `scenario`."""
    values: dict[str, Number | list[Number]] = {}
    """Numbers of the scenario file, by their names there, with a value or a list of values; lists
    multiply, the last one fastest."""
    zipped: bool = False
    """Lists of `values` go side by side, instead of multiplying."""
    conditions: dict[str, Axis] = {}
    """Axes of a matrix with the value that they have in this row."""
    varied: dict[str, Pair] = {}
    """Numbers of `values`, or axes, with the range from which repetitions draw what they add to it;
    the first run of a point adds nothing."""
    repetitions: Annotated[int, Meta(ge=1, le=REPETITIONS_MAX)] = 1
    """Runs of each point."""
    trial: Trial
    """What a run must fulfil."""

    def listed(self, name: str) -> list[Number]:
        """Values of a number, a single one also as a list."""
        value = self.values[name]
        return value if isinstance(value, list) else [value]

    @property
    def count(self) -> int:
        """Cases that it makes for one point of the matrix."""
        lengths = [len(self.listed(name)) for name in self.values]
        points = 1
        for length in lengths:
            points = max(points, length) if self.zipped else points * length
        return points * self.repetitions


class Rulebook(_Section, frozen=True, kw_only=True):
    """A test protocol: the source, its rows, and what of them may fail."""

    title: str
    """Its name on pages."""
    source: str
    """The text or files that its numbers are from."""
    rank: Rank
    """Rank of that source. A: official text; B: text or files of a third party; C: somebody's
    reading."""
    note: str = ""
    """What a reader of any of its results must know."""
    groups: dict[Name, RulebookGroup] = {}
    """Groups of rows, in the order of pages."""
    rows: Annotated[list[RulebookRow], Meta(min_length=1)]
    """Its tests."""

    def row(self, name: str) -> RulebookRow | None:
        """The row of a name; None: it has no such row."""
        return next((row for row in self.rows if row.row == name), None)
