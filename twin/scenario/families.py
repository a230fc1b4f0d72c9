"""A scenario's family class, by the table of kinds."""

from __future__ import annotations

from functools import cache

from schemas.kinds.registry import implementation
from schemas.kinds.scenario import kind_of
from schemas.sections.scenario import Scenario
from twin.scenario.protocol import Rows, ScenarioFamily, ScenarioRun
from twin.scenario.surroundings import Surroundings


def start_of(scenario: Scenario, ground: Surroundings) -> tuple[float, float, float]:
    """World x, y [m] and heading [rad] of the ego at the start of a case.

    Raises:
        ValueError: the scene is not fit for the scenario; one line.
    """
    kind = kind_of(scenario)
    return _family(kind.implementation).start(kind.config_of(scenario), ground)


def begin(scenario: Scenario, ground: Surroundings, x_m: float, y_m: float) -> ScenarioRun:
    """A case that begins at a place."""
    kind = kind_of(scenario)
    return _family(kind.implementation)(kind.config_of(scenario), ground, x_m, y_m)


def replay(scenario: Scenario, ground: Surroundings, rows: Rows) -> ScenarioRun:
    """A case as it stands after its rows, the first of which is its start."""
    x_m, y_m = rows.column("x_m"), rows.column("y_m")
    run = begin(scenario, ground, float(x_m[0]), float(y_m[0]))
    run.observe(x_m[1:], y_m[1:])
    return run


@cache
def _family(reference: str) -> ScenarioFamily:
    family: ScenarioFamily = implementation(reference)
    return family
