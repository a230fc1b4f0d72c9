"""Parts of free driving: a folder with roads, scenario files and the campaign that drives on them.

A part is 96 cases, 32 on each class of road: eight weathers by day and by night, each with two
lots of traffic. Its seed follows from a commit and its number, so nobody chooses it.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import yaml

from schemas.files.yaml_file import load_yaml
from schemas.names import WEATHERS
from twin.scenario.free_driving.chance import part_seed
from twin.scenario.free_driving.classes import CLASSES, RoadClass
from twin.scenario.free_driving.road import road_file
from twin.scenario.free_driving.traffic import scenario_file
from twin.scenario.storyboard.native.document import SHIPPED

HOURS = ("13:00", "23:00")
"""By day and by night."""
LOTS = 2
"""Lots of traffic in each weather and at each hour."""
CAMPAIGN_FILE = "campaign.yaml"
SHIPPED_SEED = 29
"""Of the files that ship with the campaign `free-driving`."""
_COMMON = Path(__file__).parent / CAMPAIGN_FILE
"""What the campaigns of all parts have in common."""


def part_files(commit: str, part: int) -> dict[str, bytes]:
    """All files of a part by name; the same bytes for the same commit and part.

    Args:
        commit: that froze the stack, 40 hexadecimal digits.
        part: number of the part, from 1.
    """
    seed = part_seed(commit, part)
    files, cases = dict[str, bytes](), list[dict[str, Any]]()
    for road_class in CLASSES:
        road = f"{road_class.name}.xodr"
        files[road] = road_file(road_class, seed)
        points = itertools.product(WEATHERS, HOURS, range(LOTS))
        for number, (weather, hour, _) in enumerate(points):
            name = f"{road_class.name}-{number:02}"
            data = scenario_file(road_class, road, name, seed)
            files[f"{name}.yaml"] = _text(data)
            cases.append(_case(road_class, road, f"{name}.yaml", weather, hour))
    files[CAMPAIGN_FILE] = _text(_campaign(commit, part, seed, cases))
    return files


def _case(
    road_class: RoadClass, road: str, storyboard: str, weather: str, hour: str
) -> dict[str, Any]:
    return {
        "scenario.storyboard": storyboard,
        "weather": weather,
        "time_of_day": hour,
        # Named, so that all cases of a road share a rig: without it each would have one of its own.
        "scenario.scene": road,
        # What the stack would drive: not slower than the robot, so its cruise control stays off.
        "autonomy.parameters.cruise_speed_mps": road_class.speed_mps[-1][1],
    }


def _campaign(commit: str, part: int, seed: int, cases: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "campaign": f"free-driving-{part:02}",
        "description": f"Free driving, part {part}, of the stack frozen by {commit[:12]}",
        "seed": seed,
        **load_yaml(_COMMON),
        "cases": cases,
    }


def _text(data: dict[str, Any]) -> bytes:
    return yaml.safe_dump(data, sort_keys=False, width=120, default_flow_style=None).encode()


def shipped_files() -> dict[str, bytes]:
    """The roads and scenarios of the campaign that ships, one of each class."""
    files = {}
    for road_class in CLASSES:
        name = f"driving-{road_class.name}"
        road = f"{name}.xodr"
        files[road] = road_file(road_class, SHIPPED_SEED)
        data = scenario_file(road_class, road, name, SHIPPED_SEED)
        head = (
            f"# Free driving on a {road_class.name}{' road' if name.endswith('rural') else ''}: "
            f"{road_class.about}.\n#\n"
            "# Written with its road by `python -m twin.scenario.free_driving.part`, from a seed.\n"
            "# A robot follows the others at the road's speeds; nothing calls for a full braking.\n"
        )
        files[f"{name}.yaml"] = head.encode() + _text(data)
    return files


def write_shipped(folder: Path) -> None:
    """Write the files that ship anew."""
    folder.mkdir(exist_ok=True)
    for name, data in shipped_files().items():
        (folder / name).write_bytes(data)


if __name__ == "__main__":
    write_shipped(SHIPPED / "free-driving")
