"""Scenario files of others, played here and by esmini: the same places, headings and events.

``python tests/e2e/compare_esmini.py --standard`` prints the figures.
"""

from __future__ import annotations

import re

import msgspec
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from compare_esmini import NCAP, STANDARD, Comparisons, scenario_files
from esmini import ESMINI, FILES
from small_scenarios import ROADS, small_scenarios

from twin.scenario.storyboard.program.actions import LaneChangeAction
from twin.scenario.storyboard.program.program import Program
from twin.world.kernel_cache import prepare_kernels

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not FILES.is_dir(), reason=f"{FILES} is missing"),
    pytest.mark.skipif(not ESMINI.is_file(), reason=f"{ESMINI} is missing"),
]


@pytest.fixture(scope="module")
def comparisons(tmp_path_factory: pytest.TempPathFactory) -> Comparisons:
    """Comparisons that share road networks."""
    prepare_kernels()
    return Comparisons(tmp_path_factory.mktemp("esmini"))


def test_all_files_agree(comparisons: Comparisons) -> None:
    results = [comparisons.compare(file) for file in scenario_files()]
    assert len(results) == 23 + 15
    assert sum(result.entities for result in results) > 50
    assert [result for result in results if not result.agrees] == []


def test_all_given_standard_variations_agree(comparisons: Comparisons) -> None:
    results = [
        result
        for file in sorted(STANDARD.glob("*.xosc"))
        for result in comparisons.compare_variations(file)
    ]
    assert len(results) == 218
    assert all(result.entities > 0 for result in results)
    assert [result for result in results if not result.agrees] == []


def test_one_per_cent_of_a_lane_change_is_caught(comparisons: Comparisons) -> None:
    def slower(program: Program) -> Program:
        elements, changed = [], 0
        for element in program.elements:
            action = element.action
            if isinstance(action, LaneChangeAction):
                dynamics = action.dynamics
                longer = msgspec.structs.replace(dynamics, value=dynamics.value * 1.01)
                action = msgspec.structs.replace(action, dynamics=longer)
                element = msgspec.structs.replace(element, action=action)
                changed += 1
            elements.append(element)
        assert changed == 1
        return msgspec.structs.replace(program, elements=tuple(elements))

    (file,) = [file for file in scenario_files() if "4_4_1_cut_in_no" in file.stem]
    assert comparisons.compare(file).agrees
    planted = comparisons.compare(file, slower)
    assert not planted.agrees
    assert planted.distance_m > 0.01
    assert planted.event_steps > 1


def test_orientations_on_routes_are_all_that_parts_the_obstructions(
    comparisons: Comparisons,
) -> None:
    """esmini ignores the orientation of a RoutePosition. Without it nothing is apart."""
    file = NCAP / "CA-FC_2026" / "CBFA.xosc"
    text = file.read_text()
    shortened, count = re.subn(
        r"</InRoutePosition>\s*<Orientation [^>]*/>", "</InRoutePosition>", text
    )
    assert count == 1
    folders = re.sub(r'path="\.\./', f'path="{file.parent.parent}/', shortened)
    anywhere = re.sub(r'filepath="\.\./\.\./\.\./', f'filepath="{NCAP.parents[1]}/', folders)
    (result,) = comparisons.compare_texts({"obstructions": anywhere})
    assert result.entities == 4
    assert result.agrees


def test_small_scenarios_agree(comparisons: Comparisons) -> None:
    """Every shape and dimension, edges with delays, priorities, arrivals, trajectories."""
    results = comparisons.compare_texts(dict(small_scenarios()), {"small.xodr": ROADS})
    assert len(results) > 110
    assert all(result.entities == 2 for result in results)
    assert [result for result in results if not result.agrees] == []
