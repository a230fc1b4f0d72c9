"""What every scenario family does alike; what is particular to one stands in its own tests."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import fields

from schemas.campaign import Scenario
from schemas.kinds.kpi import shipped
from schemas.kinds.registry import implementation
from schemas.kinds.scenario import scenario_kinds
from twin.road.lane import straight
from twin.scenario import families
from twin.scenario.surroundings import Surroundings

ROOT = Path(__file__).parents[4]
GROUND = Surroundings(straight(0.0, 2000.0), None, 1.4, 2.4, 0.9, front_offset_m=3.8)
HULL = np.array([500.0, 3.0, 0.0, 2.25, 0.9])
NAMES = [kind.name for kind in scenario_kinds().declared]


def scenario_of(name):
    """A scenario of a family, with something for each key that it needs."""
    config = scenario_kinds().find(name).config
    return Scenario(type=name, **{key.name: "x" for key in fields(config) if key.required})


def ground_of(name):
    """A free lane, beside which stand the things of a family that looks at several."""
    kind = scenario_kinds().find(name)
    step = np.array([100.0, 0.0, 0.0, 0.0, 0.0])
    further = tuple(HULL + (place + 1) * step for place in range(len(kind.further_targets)))
    return replace(GROUND, target=HULL, further=further) if further else GROUND


@pytest.mark.parametrize("name", NAMES)
def test_a_case_begins_on_the_lane_and_does_not_end_there(name):
    scenario = scenario_of(name)
    x_m, y_m, yaw_rad = families.start_of(scenario, ground_of(name))
    assert GROUND.lane.locate(x_m, y_m).lateral_m == 0.0
    assert yaw_rad == 0.0
    assert not families.begin(scenario, ground_of(name), x_m, y_m).ended()


@pytest.mark.parametrize("name", NAMES)
def test_the_columns_of_a_family_are_those_of_the_table(name):
    run = families.begin(scenario_of(name), ground_of(name), 0.0, 0.5)
    declared = {kind.name for kind in shipped("column") if kind.by_scenario}
    assert set(run.columns()) <= declared


@pytest.mark.parametrize("name", NAMES)
def test_places_one_by_one_are_places_at_once(name):
    """The engine gives them tick by tick, the judge all of them."""
    x_m, y_m = np.linspace(0.0, 70.0, 40), np.linspace(0.1, -0.6, 40)
    scenario = scenario_of(name)
    one, other = (families.begin(scenario, ground_of(name), x_m[0], y_m[0]) for _ in range(2))
    for k in range(1, 40):
        one.observe(x_m[k : k + 1], y_m[k : k + 1])
    other.observe(x_m[1:], y_m[1:])
    other.observe(x_m[:0], y_m[:0])
    assert (one.columns(), one.ended()) == (other.columns(), other.ended())
    rows = _Rows(error_m=y_m)
    assert one.scalars(rows) == other.scalars(rows)


class _Rows:
    rows = 40

    def __init__(self, error_m):
        self._error_m = error_m

    def column(self, name):
        return self._error_m if name == "lateral_error_m" else np.zeros(self.rows)

    def valid(self, _name):
        return np.zeros(self.rows, np.bool_)


@pytest.mark.parametrize("kind", scenario_kinds().declared, ids=lambda kind: kind.name)
def test_a_judge_loads_no_warp_for_it(kind):
    module = kind.implementation.partition(":")[0]
    code = f"import sys; sys.modules['warp'] = None; import {module}"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, stderr=subprocess.PIPE)
    assert done.returncode == 0, done.stderr.decode()
    assert implementation(kind.implementation).__name__
