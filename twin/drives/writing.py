"""The files of an imported drive: scenario, road and campaign."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from schemas.escape import escape
from schemas.files.yaml_file import dump_yaml
from twin.drives.drive import RecordedDrive
from twin.drives.road_along import road_text
from twin.drives.scenario import CutActor, CutDrive

SCENARIO_FILE = "scenario.yaml"
ROAD_FILE = "road.xodr"
CAMPAIGN_FILE = "campaign.yaml"

_SIDES = (("length_m", 0.2, 40.0), ("width_m", 0.2, 10.0), ("height_m", 0.2, 10.0))
_SLOWEST_MPS, _FASTEST_MPS = 1.0, 50.0
_FIRST_S = 1.0
"""Beginning of a way over which its speed is taken [s]."""


def scenario_name(path: Path) -> str:
    """A name for scenario and campaign, of the name of a recording."""
    name = re.sub(r"[^a-z0-9]+", "-", path.stem.lower()).strip("-")[:48]
    return name or "drive"


def write_drive(
    folder: Path, name: str, drive: RecordedDrive, cut: CutDrive, road: str
) -> list[Path]:
    """Write the files.

    Args:
        folder: where; it is there.
        name: of scenario and campaign.
        drive: what was read.
        cut: what is written of it.
        road: name of a shipped road or path of an OpenDRIVE file; empty: one along the ego's way.

    Raises:
        OSError: a file cannot be written.
    """
    written = [folder / SCENARIO_FILE, folder / CAMPAIGN_FILE]
    if not road:
        heading = float(cut.ego[0, 4])
        text = road_text(cut.ego[:, 1], cut.ego[:, 2], heading, f"along {name}")
        (folder / ROAD_FILE).write_text(text, encoding="utf-8")
        written.append(folder / ROAD_FILE)
    (folder / SCENARIO_FILE).write_text(
        _scenario(name, drive, cut, road or ROAD_FILE), encoding="utf-8"
    )
    (folder / CAMPAIGN_FILE).write_text(_campaign(name, folder, cut), encoding="utf-8")
    return written


def _scenario(name: str, drive: RecordedDrive, cut: CutDrive, road: str) -> str:
    moved = "" if cut.origin_m == (0.0, 0.0) else f", moved by {_pair(cut.origin_m)} m"
    objects = f"objects of {drive.objects_source}" if cut.actors else "no objects"
    about = f"A recorded drive: ego of {drive.ego_source}, {objects}, in {drive.frame}{moved}."
    lines = [dump_yaml({"scenario": name, "about": escape(about), "road": road}).rstrip()]
    lines += ["ego:", "  poses:  # time [s], x, y [m], heading [deg] of the rear axle's middle"]
    lines += _rows(cut.ego, "  ")
    if cut.actors:
        lines.append("actors:")
        for actor in cut.actors:
            lines += _actor(actor)
    events = [line for actor in cut.actors for line in _events(actor)]
    if events:
        lines += ["events:", *events]
    lines.append(f"end: {{after_s: {_number(cut.duration_s, 3)}}}")
    return "\n".join(lines) + "\n"


def _actor(actor: CutActor) -> Iterator[str]:
    yield f"  {actor.name}:  # {escape(actor.source, 80)}"
    yield f"    kind: {actor.kind}"
    for (key, least, most), side in zip(_SIDES, actor.size_m, strict=True):
        if side > 0.0:
            yield f"    {key}: {_number(min(max(side, least), most), 3)}"
    if actor.appears_s is not None:
        yield "    visible: false"
    yield "    poses:"
    yield from _rows(actor.poses, "    ")


def _events(actor: CutActor) -> Iterator[str]:
    for word, time_s, there in (
        ("appears", actor.appears_s, "true"),
        ("vanishes", actor.vanishes_s, "false"),
    ):
        if time_s is not None:
            do = f"{{{actor.name}: {{visible: {there}}}}}"
            yield f"  {actor.name}_{word}: {{at_s: {_number(time_s, 3)}, do: {do}}}"


def _rows(poses: np.ndarray, indent: str) -> Iterator[str]:
    for time_s, x_m, y_m, _, heading_rad in poses.tolist():
        place = f"{_number(x_m, 4)}, {_number(y_m, 4)}, {_number(math.degrees(heading_rad), 3)}"
        yield f"{indent}  - [{_number(time_s, 6)}, {place}]"


def _campaign(name: str, folder: Path, cut: CutDrive) -> str:
    cruise = min(max(_first_speed_mps(cut.ego), _SLOWEST_MPS), _FASTEST_MPS)
    data = {
        "campaign": name,
        "camera": {"width": 640, "height": 360, "hz": 10},
        "scenario": {
            "type": "storyboard",
            "storyboard": str((folder / SCENARIO_FILE).absolute()),
            "duration_s": math.ceil(cut.duration_s) + 1,
        },
        "autonomy": {"parameters": {"cruise_speed_mps": round(cruise, 1)}},
        "matrix": {"weather": ["clear"]},
    }
    head = "# The stack drives the ego from the beginning; see the page on ROS 2 recordings.\n"
    return head + dump_yaml(data)


def _first_speed_mps(poses: np.ndarray) -> float:
    """Mean speed over the first :data:`_FIRST_S` of a way [m/s]: what comes later may be the
    reaction of whoever drove, and a stack that wants another speed brakes from the beginning.

    Args:
        poses: time [s], x, y, z [m] and heading [rad] each, in order of time, at least two.
    """
    first = poses[: max(2, int(np.searchsorted(poses[:, 0], poses[0, 0] + _FIRST_S, "right")))]
    way_m = float(np.hypot(*np.diff(first[:, 1:3], axis=0).T).sum())
    return way_m / float(first[-1, 0] - first[0, 0])


def _number(value: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def _pair(values: tuple[float, float]) -> str:
    return ", ".join(f"{value:g}" for value in values)
