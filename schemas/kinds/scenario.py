"""The table of scenario families: what the ego is asked to do, and how reports speak of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import msgspec
from msgspec import UNSET, Struct

from schemas.kinds.kpi import KpiKind, scalars_by_name, shipped
from schemas.kinds.registry import Kinds, read_kinds
from schemas.kinds.verdict import VERDICTS, VerdictKind

if TYPE_CHECKING:  # the section is made of this table
    from schemas.sections.scenario import Scenario

GROUP = "drivetwin.scenarios"
"""Entry points that bring scenario families."""

OURS = {
    "jump_scare": "schemas.kinds.scenarios.jump_scare:KIND",
    "lane_keeping": "schemas.kinds.scenarios.lane_keeping:KIND",
}
"""Those that are shipped; the same as in pyproject.toml."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeadMeasure:
    """The scalar that reports show first, for a system under test and for every case."""

    scalar: str
    of: Literal["unhurt", "decided"]
    """Cases that count: those without a collision, or all with a verdict."""
    head: str
    """Head of its column, without the unit."""
    title: str
    """A sentence about the column."""
    text: str
    """In sentences, without the unit."""
    hover: str
    """Of one case, with its value: ``smallest distance {:.3f} m``."""
    digits: int = 2
    """After the point, in tables; in the cells of a map one less."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtremeTable:
    """A table of the cases with the largest or smallest values of a scalar."""

    scalar: str
    largest: bool
    of: Literal["unhurt", "decided"]
    title: str
    """Of the table on the page."""
    head: str
    """Of its column on the page."""
    said: str
    """Title on a results page."""
    said_head: str
    """Head on a results page."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictTable:
    """A table on a results page that counts one verdict by the campaign's axes."""

    verdict: str
    some: str
    """Sentence before it; may name keys of the scenario: ``{false_braking_m:g}``."""
    none: str
    """Sentence where there is no such case."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioReport:
    """How reports show the cases of a scenario; texts may name its keys: ``{distance_m:g}``."""

    rule: str
    """What passing means, in full sentences; on the page."""
    rule_in_results: str
    """Likewise, on a results page, in Markdown."""
    curves: tuple[str, ...]
    """KPI columns drawn for a case, from top to bottom."""
    overview: tuple[str, ...]
    """Those drawn side by side for all systems under test."""
    table: tuple[str, ...]
    """Scalars of the case table, from left to right."""
    beside: tuple[tuple[str, str], ...]
    """Head and scalar of what stands beside an extreme on a results page."""
    lead: LeadMeasure
    extreme: ExtremeTable
    extremes_title: str
    """Heading of the extremes on a results page."""
    counted_title: str
    """Heading of ``counted`` on a results page."""
    counted: tuple[VerdictTable, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioKind:
    """Declaration of a scenario family."""

    name: str
    doc: str
    """One sentence for ``--help`` and docs."""
    config: type[Struct]
    """Keys that only this family has, with types, ranges, defaults and meanings."""
    implementation: str
    """``module:attribute`` of its :class:`twin.scenario.protocol.ScenarioFamily`."""
    report: ScenarioReport
    target: str = "obstacle"
    """Whose hull DTC and TTC are about: ``obstacle``, the broken-down car of the scene, or the name
    of a thing that stands in the scene."""
    stops_for_target: bool
    """The ego is to stop for the target: DTC decides, and an AEB trigger far from it is early."""
    as_autodrive: bool = False
    """Its cases can be exported as logs of the AutoDRIVE study, which knows this one scenario."""
    verdicts: tuple[VerdictKind, ...] = ()
    """Verdict words that only this family has."""
    kpis: tuple[str, ...] = ()
    """Scalars that its cases have beside those of all; each is declared as a KPI."""

    @property
    def scalars(self) -> tuple[KpiKind, ...]:
        """Scalars of its cases, in the order of files."""
        return (*shipped("scalar"), *(scalars_by_name()[name] for name in self.kpis))

    def config_of(self, scenario: Scenario) -> Any:
        """The keys of this family in a scenario, as ``config``.

        Raises:
            ValueError: one is missing or not allowed.
        """
        names = self.config.__struct_fields__
        given = {name: getattr(scenario, name) for name in names}
        known = {name: value for name, value in given.items() if value is not UNSET}
        value: Any = msgspec.convert(known, self.config)
        return value


@cache
def scenario_kinds() -> Kinds[ScenarioKind]:
    """All scenario families, the shipped ones first."""
    found = read_kinds(GROUP, ScenarioKind, OURS)
    taken = {"type", "scene", "vehicle", "ego_speed_mps", "duration_s", "standstill_s"}
    broken, good = dict(found.broken), []
    for kind in found.declared:
        if mistake := _mistake(kind, taken):
            broken[kind.name] = f"scenario '{kind.name}': {mistake}"
        else:
            good.append(kind)
            taken |= set(kind.config.__struct_fields__)
    return Kinds(tuple(good), broken)


def _mistake(kind: ScenarioKind, taken: set[str]) -> str:
    """Why a family cannot be used beside those before it; empty: it can."""
    if keys := [name for name in kind.config.__struct_fields__ if name in taken]:
        return f"its key '{keys[0]}' is one of the section or of another family"
    if unknown := [name for name in kind.kpis if name not in scalars_by_name()]:
        return f"no distribution declares its scalar '{unknown[0]}'"
    return ""


def kind_of(scenario: Scenario) -> ScenarioKind:
    """The declaration of a scenario's family."""
    return _by_name()[scenario.type]


@cache
def _by_name() -> dict[str, ScenarioKind]:
    return {kind.name: kind for kind in scenario_kinds().declared}


@cache
def verdict_kinds() -> tuple[VerdictKind, ...]:
    """All verdict words, those of the shipped scenarios first, in the order of reports."""
    words = {verdict.name: verdict for verdict in VERDICTS}
    for kind in scenario_kinds().declared:
        for verdict in kind.verdicts:
            words.setdefault(verdict.name, verdict)
    return tuple(words.values())
