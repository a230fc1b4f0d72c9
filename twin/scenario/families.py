"""A scenario's family class, by the table of kinds."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from schemas.case import Case
from schemas.kinds.registry import implementation
from schemas.kinds.scenario import kind_of
from schemas.sections.scenario import Scenario
from twin.scenario.protocol import Rows, ScenarioFamily, ScenarioRun
from twin.scenario.surroundings import Surroundings

if TYPE_CHECKING:
    from twin.scenario.case_motion import CaseMotion, CaseMotionMaker
    from twin.vehicle.vehicle_file import Vehicle
    from twin.world.scene import Scene
    from twin.world.street.build import World


def start_of(scenario: Scenario, ground: Surroundings) -> tuple[float, float, float]:
    """World x, y [m] and heading [rad] of the ego at the start of a case.

    Raises:
        ValueError: the scene is not fit for the scenario; one line.
    """
    kind = kind_of(scenario)
    return _family(kind.implementation).start(kind.config_of(scenario), ground)


def scene_of(case: Case) -> Scene:
    """The scene of a case: that of its rig, or the one that the file of its scenario brings.

    Raises:
        ValueError: it cannot be used; one line.
    """
    from twin.world.scene import load_scene  # who judges what is written needs no world

    scenario = case.variation.scenario
    kind = kind_of(scenario)
    if kind.scene_name and case.rig.scene != scenario.scene:
        named: str = implementation(kind.scene_name)(kind.config_of(scenario))
        return load_scene(named)
    return load_scene(case.rig.scene)


def motion_of(
    case: Case, vehicle: Vehicle, world: World, slots: int, device: Any
) -> CaseMotion | None:
    """What moves the bodies of a rig's cases; None: they bring none.

    Raises:
        ValueError: the rig cannot have it; one line.
    """
    if not case.rig.bodies:
        return None
    maker: CaseMotionMaker = implementation(kind_of(case.variation.scenario).motion)
    return maker(case, vehicle, world.kinds, slots, device, world.signals)


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


def observe_all(runs: Sequence[ScenarioRun], x_m: np.ndarray, y_m: np.ndarray) -> None:
    """The next place of the ego of each of ``runs``, world [runs] [m]."""
    for family in {type(run): None for run in runs}:
        own = [number for number, run in enumerate(runs) if type(run) is family]
        # Its own, not that of a family which it extends: that knows nothing of its `observe`.
        if "observe_together" in vars(family):
            kind: Any = family
            kind.observe_together([runs[number] for number in own], x_m[own], y_m[own])
        else:
            for number in own:
                runs[number].observe(x_m[number : number + 1], y_m[number : number + 1])


@cache
def _family(reference: str) -> ScenarioFamily:
    family: ScenarioFamily = implementation(reference)
    return family
