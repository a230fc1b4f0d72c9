"""What is wrong with an objective that is a formula."""

from __future__ import annotations

from msgspec import UNSET

from schemas.formulas.parse import parse_formula
from schemas.formulas.tree import columns_of
from schemas.kinds.kpi import shipped
from schemas.kinds.kpis.formula import ROBUSTNESS
from schemas.kinds.scenario import ScenarioKind
from schemas.sections.search import Objective
from schemas.validation import Mistake, suggest

NUMERIC = ("bool", "int32", "int64", "float64")
"""Types of the columns that a formula may name."""


def formula_columns(kind: ScenarioKind) -> list[str]:
    """Names of the columns that formulas of a scenario may use: numbers and switches of its cases'
    KPI rows."""
    others = [c.name for c in shipped("column") if c.type in NUMERIC and not c.by_scenario]
    given = [c.name for c in shipped("column") if c.by_scenario and c.name in kind.report.curves]
    return [*others, *given, *(column.name for column in kind.columns)]


def formula_mistakes(objective: Objective, formula: str, kind: ScenarioKind) -> list[Mistake]:
    """What is wrong with a formula, and with what stands beside it."""
    beside = [name for name in ("fails_above", "goal") if getattr(objective, name) is not UNSET]
    if objective.kpi != ROBUSTNESS:
        beside.append("kpi")
    if objective.fails_below != 0.0:
        beside.append("fails_below")
    mistakes = [
        Mistake(f"search.objective.{name}", "a formula is the objective; remove one of the two")
        for name in beside
    ]
    try:
        names = columns_of(parse_formula(formula))
    except ValueError as error:
        return [*mistakes, Mistake("search.objective.formula", str(error))]
    known = formula_columns(kind)
    for name in names:
        if name not in known:
            problem = f"no column '{name}' of scenario type {kind.name}; {suggest(name, known)}"
            mistakes.append(Mistake("search.objective.formula", problem))
    return mistakes
