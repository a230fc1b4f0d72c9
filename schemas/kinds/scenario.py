"""The table of scenario families: what the ego is asked to do, and how reports speak of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, Protocol

import msgspec
from msgspec import UNSET, Struct

from schemas.kinds.kpi import KpiKind, columns_by_name, scalars_by_name, shipped
from schemas.kinds.registry import Kinds, read_kinds
from schemas.kinds.verdict import LEVEL_OF_PASSING, VERDICTS, VerdictKind

GROUP = "drivetwin.scenarios"
"""Entry points that bring scenario families."""

OURS = {"shipped": "schemas.kinds.scenarios:KINDS"}
"""Scenario families that are shipped; the same as in pyproject.toml."""


class NamesFamily(Protocol):
    """A scenario of a campaign, whose section is made of this table."""

    @property
    def type(self) -> str:
        """Name of the scenario's family."""


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
    """Name in sentences, without the unit."""
    hover: str
    """Text about one case, with its value: ``smallest distance {:.3f} m``."""
    digits: int = 2
    """Digits after the point, in tables; in the cells of a map one less."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtremeTable:
    """A table of the cases with the largest or smallest values of a scalar."""

    scalar: str
    largest: bool
    of: Literal["unhurt", "decided"]
    title: str
    """Title of the table on the page."""
    head: str
    """Head of its column on the page."""
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
    """What passing means, on a results page, in Markdown."""
    curves: tuple[str, ...]
    """KPI columns drawn for a case, from top to bottom."""
    overview: tuple[str, ...]
    """KPI columns drawn side by side for all systems under test."""
    table: tuple[str, ...]
    """Scalars of the case table, from left to right."""
    beside: tuple[tuple[str, str], ...] = ()
    """Head and scalar of what stands beside an extreme on a results page."""
    lead: LeadMeasure
    extreme: ExtremeTable
    extremes_title: str = "Extremes"
    """Heading of the extremes on a results page."""
    counted_title: str = ""
    """Heading of ``counted`` on a results page."""
    counted: tuple[VerdictTable, ...] = ()


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
    """Object whose hull DTC and TTC are about: ``obstacle``, the broken-down car of the scene, or
    the name of a thing that stands in the scene."""
    further_targets: tuple[str, ...] = ()
    """Names of further things that the family looks at: their hulls are
    :attr:`twin.scenario.surroundings.Surroundings.further`, in this order."""
    stops_for_target: bool
    """The ego is to stop for the target: DTC decides, and an AEB trigger far from it is early."""
    as_autodrive: bool = False
    """Its cases can be exported as logs of the AutoDRIVE study, which knows this one scenario."""
    verdicts: tuple[VerdictKind, ...] = ()
    """Verdict words that only this family has."""
    kpis: tuple[str, ...] = ()
    """Scalars and columns that its cases have beside those of all; each is declared as a KPI."""
    files: tuple[str, ...] = ()
    """Keys whose values are names of shipped files, or paths; files count by their contents."""
    brings_scene: str = ""
    """The one of ``files`` whose file says where the case takes place, unless ``scene`` does."""
    scene_name: str = ""
    """``module:attribute`` of a function that says which scene it is: config -> name or path."""
    numbers: str = ""
    """Key with numbers of the file by name, which axes of a matrix set as ``FAMILY.NAME``."""
    trial: str = ""
    """Key with the :class:`schemas.sections.trial.Trial` of a run, which rows of a rulebook set;
    empty: the family knows none."""
    motion: str = ""
    """``module:attribute`` of its :class:`twin.scenario.case_motion.CaseMotionMaker`, if its cases
    bring bodies that move; empty: what moves stands in the scene."""
    bodies: int = 0
    """Most bodies of a case that move by the scenario."""
    ends_at_rest: bool = True
    """A case ends ``standstill_s`` after the ego has come to rest."""
    nearest: bool = False
    """DTC and TTC are about the nearest of all hulls, not about ``target``."""
    checks: str = ""
    """``module:attribute`` of a function that says what is wrong with cases before one is leased:
    list of :class:`schemas.case.Case` -> lines."""

    @property
    def scalars(self) -> tuple[KpiKind, ...]:
        """Scalars of its cases, in the order of files."""
        kinds = (scalars_by_name()[name] for name in self.kpis if name in scalars_by_name())
        return (*shipped("scalar"), *kinds)

    @property
    def columns(self) -> tuple[KpiKind, ...]:
        """Columns that its cases have behind those of all, in the order of files: first those that
        the family gives, then those that are computed."""
        kinds = [columns_by_name()[name] for name in self.kpis if name in columns_by_name()]
        return tuple(sorted(kinds, key=lambda kind: bool(kind.implementation)))

    def files_of(self, scenario: NamesFamily) -> tuple[str, ...]:
        """Names or paths of the files that a scenario of this family names."""
        return tuple(str(getattr(scenario, key)) for key in self.files)

    def scene_of(self, scenario: NamesFamily, usual: str) -> str:
        """What names the scene of a scenario: its ``scene``, or the file that brings one where
        ``scene`` is the ``usual`` one."""
        scene = str(scenario.scene)  # type: ignore[attr-defined]
        if not self.brings_scene or scene != usual:
            return scene
        return str(getattr(scenario, self.brings_scene))

    def config_of(self, scenario: NamesFamily) -> Any:
        """The keys of this family in a scenario, as ``config``.

        Raises:
            ValueError: one is missing or not allowed.
        """
        names = self.config.__struct_fields__
        values = {name: getattr(scenario, name) for name in names}
        known = {name: value for name, value in values.items() if value is not UNSET}
        value: Any = msgspec.convert(known, self.config)
        return value


@cache
def scenario_kinds() -> Kinds[ScenarioKind]:
    """All scenario families, the shipped ones first."""
    kinds = read_kinds(GROUP, ScenarioKind, OURS)
    taken = {"type", "scene", "vehicle", "ego_speed_mps", "duration_s", "standstill_s"}
    taken |= {"load_kg", "load_x_m", "load_y_m", "load_z_m"}
    broken, good = dict(kinds.broken), []
    for kind in kinds.declared:
        if mistake := _mistake(kind, taken):
            broken[kind.name] = f"scenario '{kind.name}': {mistake}"
        else:
            good.append(kind)
            taken |= set(kind.config.__struct_fields__)
    return Kinds(tuple(good), broken, kinds.brought)


def _mistake(kind: ScenarioKind, taken: set[str]) -> str:
    """Why a family cannot be used beside those before it; empty: it can."""
    if keys := [name for name in kind.config.__struct_fields__ if name in taken]:
        return f"its key '{keys[0]}' is one of the section or of another family"
    if unknown := [n for n in kind.kpis if n not in scalars_by_name() | columns_by_name()]:
        return f"no distribution declares its KPI '{unknown[0]}'"
    every = {column.name for column in shipped("column")}
    if twice := [name for name in kind.kpis if name in every]:
        return f"its KPI '{twice[0]}' is one of every case"
    if odd := [c.name for c in kind.columns if c.type != "float64" or not c.nullable]:
        return f"its KPI column '{odd[0]}' must be of type float64 and nullable"
    drawn = {c.name for c in (*shipped("column"), *kind.columns) if c.curve is not None}
    if bare := [name for name in kind.report.curves if name not in drawn]:
        return f"its report draws '{bare[0]}', which is no column of its cases with a curve"
    return ""


def kind_of(scenario: NamesFamily) -> ScenarioKind:
    """The declaration of a scenario's family."""
    return _by_name()[scenario.type]


def trial_of(scenario: NamesFamily) -> Any:
    """The :class:`schemas.sections.trial.Trial` of a scenario's runs; None: it has none."""
    key = kind_of(scenario).trial
    trial = getattr(scenario, key) if key else UNSET
    return None if trial is UNSET else trial


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


@cache
def passing_words() -> frozenset[str]:
    """Verdict words with which a case has passed."""
    return frozenset(verdict.name for verdict in verdict_kinds() if verdict.passes)


@cache
def levels_of_verdicts() -> dict[str, int]:
    """Level of each verdict word, those that pass included
    (:attr:`schemas.kinds.verdict.VerdictKind.level`)."""
    return {v.name: LEVEL_OF_PASSING if v.passes else v.level for v in verdict_kinds()}
