"""conductor.report.reading.provenance: what the cases of a report were built of."""

from __future__ import annotations

from typing import Any

import pytest
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign

from conductor.report.reading.dossier import open_dossier
from conductor.report.reading.provenance import NAMES_MAX, built_of

STORYBOARD = {"type": "storyboard", "storyboard": "cut-in"}
FILES = [f"/home/me/s{number}.yaml" for number in range(NAMES_MAX + 3)]
FIRST = ", ".join(f"s{number}.yaml" for number in range(NAMES_MAX))


@pytest.mark.parametrize(
    ("scenario", "axes", "scenes", "vehicles"),
    [
        ({}, {}, "downtown", "opencav"),
        ({"scene": "crossing"}, {}, "crossing", "opencav"),
        ({}, {"scenario.vehicle": ["opencav", "/x/mine.yaml"]}, "downtown", "opencav, mine.yaml"),
        (STORYBOARD, {}, "cut-in", "opencav"),
        (STORYBOARD | {"scene": "motorway"}, {}, "motorway", "opencav"),
        (STORYBOARD, {"scenario.storyboard": FILES[:2]}, "s0.yaml, s1.yaml", "opencav"),
        (STORYBOARD, {"scenario.storyboard": FILES}, f"{FIRST} and 3 more", "opencav"),
    ],
)
def test_scenes_and_vehicles_are_those_of_the_cases(
    tmp_path, scenario, axes: dict[str, Any], scenes, vehicles
):
    matrix = {"model": ["yolov3"], "weather": ["clear", "heavy_fog"], **axes}
    make_campaign(tmp_path / "run", campaign_data(scenario=scenario, matrix=matrix))
    assert built_of(open_dossier(tmp_path / "run")) == [scenes, vehicles]
