"""What is wrong with cases of lane keeping, before one of them is leased."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from schemas.case import Case
from schemas.files.yaml_file import YamlError
from schemas.kinds.scenarios.lane_keeping import KIND
from twin.road.lane import LanePath
from twin.scenario.lane_keeping.family import lane_mistake
from twin.world.road_scene import road_lane
from twin.world.scene import Scene, load_scene


def case_mistakes(cases: Sequence[Case]) -> list[str]:
    """One line for each thing that is wrong with the lanes of cases, each once."""
    return list(dict.fromkeys(line for case in cases for line in _mistakes(case)))


def _mistakes(case: Case) -> Iterator[str]:
    try:
        scene = load_scene(case.rig.scene)
        lane = _lane(scene)
    except (ValueError, YamlError):
        return  # said where scenes are looked at
    config = KIND.config_of(case.variation.scenario)
    if mistake := lane_mistake(config, case.rig.scene, lane):
        yield mistake


def _lane(scene: Scene) -> LanePath | None:
    """The lane of the ego; None: the scene has none.

    Raises:
        ValueError: its roads cannot be used.
    """
    lane: LanePath | None = scene.road.lane() if scene.street else None
    return road_lane(scene.opendrive).path if scene.opendrive else lane
