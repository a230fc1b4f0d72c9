"""The table of KPIs: what is measured, what it is called, and how it is drawn and compared.

A KPI is a column (one value per control tick), a scalar (one value per case) or a name (a scalar
that is a text). Missing is null, never 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

from schemas.kinds.registry import Kinds, implementation, read_kinds

GROUP = "drivetwin.kpis"
"""Entry points that bring KPIs."""

OURS = {
    "base": "schemas.kinds.kpis.base:KPIS",
    "storyboard": "schemas.kinds.kpis.storyboard:KPIS",
    "formula": "schemas.kinds.kpis.formula:KPIS",
}
"""KPIs that are shipped; the same as in pyproject.toml."""

KpiType = Literal["bool", "int32", "int64", "float64", "detections", "name"]
Place = Literal["column", "scalar", "name"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveLook:
    """Looks of a column that reports draw over time."""

    place: int
    """Place from the top of a page, small first."""
    title: str
    axis: str
    """Title of its axis, unit in brackets."""
    height: float = 0.8
    """Height of its row, as a share of a row of height 1."""
    steps: bool = False
    """Whether it changes in steps: both sides of every change are drawn."""
    scale: Literal["from 0", "0 to 1", "switch", "count", "signed"] = "from 0"
    """Scale of its axis. ``switch``: 0 or 1."""
    spread: tuple[str, str] | None = None
    """Title of its row and of its axis where there are too many cases for a line each; None: lines
    are drawn anyway."""
    share: bool = False
    """Whether, of many cases, the share in which it is on is drawn instead of quantiles."""
    safety_m: float = 0.0
    """A line across it, the factor of safety; 0: none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """Column of which a scalar is the extreme: how a case came to its value, tick by tick."""

    column: str
    """Column that comes with every row."""
    extreme: Literal["least", "most"]
    size: bool = False
    """Whether the column counts without its sign."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KpiKind:
    """Declaration of one KPI."""

    name: str
    place: Place
    type: KpiType
    """``detections``: a list of (label, confidence, x, y, width, height); ``name``: what the scene
    calls an object. A column has the shape [ticks], anything else is one value."""
    unit: str = ""
    doc: str = ""
    nullable: bool = False
    by_scenario: bool = False
    """A scenario's family gives it; it is missing in the cases of all others."""
    label: str = ""
    """Head of its column in tables, unit in brackets; empty: it stands in none."""
    digits: int = 2
    """Digits after the point, in tables."""
    better: Literal["more", "less", ""] = ""
    """Which values are the better ones; empty: neither."""
    compared: str = ""
    """Name of its difference between two runs of a case, with unit; the median and mean of the
    differences are compared. Empty: it is not compared."""
    panel: str = ""
    """Short name beside a case's picture; empty: it does not stand there."""
    curve: CurveLook | None = None
    """Looks of its curve; None: it is not drawn."""
    course: Course | None = None
    """Column of which it is the extreme; None: of none. A case may pass the extreme of its rows at
    its very end, as a collision between two of them does."""
    implementation: str = ""
    """``module:attribute`` of a function that takes the rows of a case,
    :class:`twin.scenario.protocol.Rows`: a column's gives float64 [rows], NaN where missing; a
    scalar's gives a number or None. Empty: the recorder or the scenario's family gives it."""


@cache
def kpi_kinds() -> Kinds[KpiKind]:
    """All KPIs, the shipped ones first, in the order of files."""
    return read_kinds(GROUP, KpiKind, OURS)


@cache
def shipped(place: Place) -> tuple[KpiKind, ...]:
    """The KPIs of every case, in the order of files."""
    kinds: tuple[KpiKind, ...] = implementation(OURS["base"])
    return tuple(kind for kind in kinds if kind.place == place)


@cache
def scalars_by_name() -> dict[str, KpiKind]:
    """Every scalar, also those that only some scenarios have."""
    return {kind.name: kind for kind in kpi_kinds().declared if kind.place == "scalar"}


@cache
def columns_by_name() -> dict[str, KpiKind]:
    """Every column, also those that only some scenarios have: those of every file first."""
    return {kind.name: kind for kind in kpi_kinds().declared if kind.place == "column"}


@cache
def drawn_columns() -> tuple[KpiKind, ...]:
    """The columns that reports draw, from top to bottom."""
    every = columns_by_name().values()
    placed = [(kind.curve.place, kind) for kind in every if kind.curve is not None]
    return tuple(kind for _, kind in sorted(placed, key=lambda pair: pair[0]))
