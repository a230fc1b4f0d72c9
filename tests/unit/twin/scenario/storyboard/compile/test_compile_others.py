"""Files of others (Euro NCAP, ALKS), unchanged: all of them become programs."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from twin.scenario.storyboard.compile.compiler import RoadCache, compile_with_notes
from twin.scenario.storyboard.openscenario.scenario import (
    EffectiveScenario,
    Permutation,
    expand,
    read_scenario,
)

FILES = Path(__file__).parents[7] / "shared" / "data" / "openscenario"
pytestmark = pytest.mark.skipif(not FILES.is_dir(), reason=f"{FILES} is missing")


def _first_valid(permutations: list[Permutation]) -> EffectiveScenario:
    """The first permutation that keeps the constraints of its parameters; not all do."""
    mistakes = []
    for permutation in permutations:
        try:
            return permutation.scenario()
        except ValueError as error:
            mistakes.append(str(error))
    raise AssertionError(mistakes)


@pytest.mark.slow
def test_every_scenario_and_a_permutation_of_every_distribution() -> None:
    cache: RoadCache = {}
    notes: list[str] = []
    scenarios, distributions, entities = 0, 0, 0
    for path in sorted(FILES.rglob("*.xosc")):
        effective = read_scenario(path)
        if effective.kind == "DistributionFile":
            element = effective.root.first("ParameterValueDistribution")
            assert element is not None
            named = element.first("ScenarioFile")
            assert named is not None
            target = path.parent / str(named.values["filepath"])
            effective = _first_valid(expand(target, path))
            distributions += 1
        if effective.kind == "CatalogFile":
            with pytest.raises(ValueError, match="a CatalogFile is no scenario to play"):
                compile_with_notes(effective)
            continue
        scenarios += 1
        result = compile_with_notes(effective, cache)
        notes += result.notes
        entities += len(result.program.entities)
        assert result.program.network is not None
        assert result.program.elements[0].stop is not None
    assert (scenarios, distributions) == (38 + 124, 124)
    assert entities > 300
    assert {note.split(": ")[2] for note in notes} == {"the rate of -3 counts as 3"}
    assert len(cache) < scenarios
