"""A campaign on streets that nobody has seen: drawn from the commit that froze the stack.

``python -m devkit.fusion.frozen --commit HASH --out FOLDER`` writes eight streets and a campaign of
256 cases on them. Every number comes from SHA-256 of the commit's name, so nobody chooses it: who
changes the stack, and so the commit, gets other streets. ``--quick`` writes the first eight cases.

All draws that were ever made stand in ``tuning/draws.yaml`` with what came of them; ``make frozen``
adds its own before it runs. A draw that is not listed is no proof of anything.
"""

from __future__ import annotations

import argparse
import hashlib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from schemas.names import WEATHERS

STREETS = 8
MODELS = ("yolov2-w25", "yolov2-tiny-w25", "yolov3-w25", "yolov3-tiny-w25")
DRAWS = Path(__file__).parent / "tuning" / "draws.yaml"
"""List of all draws."""
COMMIT = re.compile("[0-9a-f]{40}")
"""Name of a commit, in full."""
QUICK_CASES = 8


class Draw:
    """Numbers drawn from a commit: each from SHA-256 of its name and a count."""

    def __init__(self, commit: str) -> None:
        """Begin; ``commit`` is 40 hexadecimal digits."""
        self._commit = commit
        self._count = 0

    def number(self, low: float, high: float, digits: int = 2) -> float:
        """A number from ``low`` to ``high``, rounded."""
        text = f"{self._commit} {self._count}".encode()
        self._count += 1
        share = int.from_bytes(hashlib.sha256(text).digest()[:6], "big") / 2.0**48
        return round(low + (high - low) * share, digits)

    def whole(self, low: int, high: int) -> int:
        """A whole number from ``low`` to ``high``, both included."""
        return min(int(self.number(low, high + 1, 9)), high)

    def one_of(self, values: Sequence[Any]) -> Any:
        """One of the values."""
        return values[self.whole(0, len(values) - 1)]


def seed_of(commit: str) -> int:
    """Seed of the campaign: the first four bytes of SHA-256 of the commit's name."""
    return int.from_bytes(hashlib.sha256(commit.encode()).digest()[:4], "big")


def street(draw: Draw, number: int) -> dict[str, Any]:
    """A scene file's content; nothing on it comes into the ego's lane before the obstacle."""
    lane_m, parking_m = draw.number(3.3, 3.7), draw.number(2.1, 2.4)
    kerb_m, footway_m = draw.number(0.1, 0.16), draw.number(3.6, 4.8)
    right_m = -(0.5 * lane_m + parking_m)
    obstacle_m = draw.number(228.0, 252.0, 1)
    crossings = [draw.number(low, low + 40.0, 1) for low in (0.0, 110.0, 280.0)]
    color = [draw.number(0.03, 0.5) for _ in range(3)]
    walk_m = right_m - draw.number(1.6, footway_m - 0.8)
    stand_m = right_m - draw.number(0.5, 0.9)
    begin_m, end_m, oncoming_mps = 360.0, -66.0, draw.number(8.0, 14.0, 1)
    # The next one begins when the last has gone.
    repeat_s = round((begin_m - end_m) / oncoming_mps + draw.number(2.0, 20.0, 1), 1)
    objects = [
        {"kind": "pedestrian", "name": "walks along", "seed": draw.whole(1, 9999),
         "waypoints": [[draw.number(90.0, 130.0, 1), round(walk_m, 2), kerb_m],
                       [obstacle_m - 6.0, round(walk_m, 2), kerb_m]],
         "speed_mps": draw.number(1.0, 1.6), "start_s": -draw.number(5.0, 30.0, 1)},
        {"kind": "pedestrian", "name": "at the kerb", "seed": draw.whole(1, 9999),
         "waypoints": [[obstacle_m - draw.number(20.0, 60.0, 1), round(stand_m, 2), kerb_m]],
         "yaw_deg": draw.number(0.0, 180.0, 0)},
        {"kind": "car", "name": "oncoming car", "seed": draw.whole(1, 9999),
         "body": draw.one_of(["suv", "hatchback"]), "present": "moving", "repeat_s": repeat_s,
         "waypoints": [[begin_m, lane_m], [end_m, lane_m]],
         "speed_mps": oncoming_mps, "start_s": -draw.number(1.0, 12.0, 1)},
        {"kind": "cyclist", "name": "oncoming cyclist", "seed": draw.whole(1, 9999),
         "color": [draw.number(0.03, 0.5) for _ in range(3)], "present": "moving",
         "waypoints": [[330.0, round(lane_m + 1.15, 2)], [-60.0, round(lane_m + 1.15, 2)]],
         "speed_mps": draw.number(3.8, 5.6), "start_s": -draw.number(2.0, 20.0, 1)},
    ]  # fmt: skip
    return {
        "schema": 1,
        "scene": f"frozen-{number}",
        "seed": draw.whole(1, 10**6),
        "origin": {
            "latitude_deg": 34.8,
            "longitude_deg": -82.32,
            "altitude_m": 250.0,
            "heading_deg": draw.number(0.0, 359.0, 0),
        },
        "obstacle": {
            "x_m": obstacle_m,
            "y_m": draw.number(-0.3, 0.3),
            "color": color,
            "hazard_lights": False,
        },
        "road": {
            "start_m": -65.0,
            "end_m": 345.0,
            "lane_width_m": lane_m,
            "parking_width_m": parking_m,
            "sidewalk_width_m": footway_m,
            "kerb_height_m": kerb_m,
            "cross_streets_m": crossings,
            "cross_street_width_m": draw.number(9.0, 13.0, 1),
        },
        "buildings": {
            "width_m": [draw.number(8.0, 12.0, 1), draw.number(18.0, 28.0, 1)],
            "height_m": [draw.number(8.0, 12.0, 1), draw.number(20.0, 34.0, 1)],
            "depth_m": 14.0,
        },
        "furniture": {
            "tree_spacing_m": draw.number(12.0, 26.0, 1),
            "lamp_spacing_m": draw.number(24.0, 36.0, 1),
            "lamp_height_m": draw.number(6.5, 9.0, 1),
            "lamp_intensity_cd": draw.number(1500.0, 2600.0, 0),
            "parked_cars": draw.number(0.25, 0.8),
        },
        "objects": objects,
    }


def campaign(commit: str, streets: Sequence[str], hours: Sequence[str]) -> dict[str, Any]:
    """The campaign's content: each street, the path of its file, has its hour; models and weathers
    are those of aeb-256, without their wind.

    The stack holds its wheel straight, and the gusts of heavy snow turn the car by 0.4 degrees
    while it gathers speed: 0.8 m aside after 130 m, into the parked cars. UN R152 wants such tests
    without wind as well.
    """
    cases = [
        {
            "model": model,
            "weather": weather,
            "time_of_day": hour,
            "scenario.scene": path,
        }
        for path, hour in zip(streets, hours, strict=True)
        for model in MODELS
        for weather in WEATHERS
    ]
    return {
        "extends": "aeb-256-fusion",
        "campaign": f"fusion-frozen-{commit[:8]}",
        "description": f"256 cases on streets drawn from commit {commit[:12]}",
        "seed": seed_of(commit),
        "environment": {"wind": 0.0},
        "matrix": {},
        "cases": cases,
    }


def write(commit: str, folder: Path, *, quick: bool) -> Path:
    """Write streets and campaign into ``folder``.

    Returns:
        The campaign file.

    Raises:
        ValueError: ``commit`` is no full name of a commit.
    """
    if not COMMIT.fullmatch(commit):
        raise ValueError(f"--commit {commit!r}: give 40 hexadecimal digits, as git rev-parse HEAD")
    draw = Draw(commit)
    folder.mkdir(parents=True, exist_ok=True)
    streets, hours = [], []
    for number in range(1, STREETS + 1):
        path = folder / f"frozen-{number}.yaml"
        path.write_text(yaml.safe_dump(street(draw, number), sort_keys=False), "utf-8")
        streets.append(str(path))
        hours.append(f"{draw.whole(5, 19):02d}:{draw.whole(0, 11) * 5:02d}")
    data = campaign(commit, streets, hours)
    if quick:
        # One case per street, so that every weather and every model is in it.
        data["campaign"] += "-quick"
        data["cases"] = [data["cases"][32 * n + 8 * (n % 4) + n] for n in range(QUICK_CASES)]
    file = folder / ("quick.yaml" if quick else "campaign.yaml")
    file.write_text(yaml.safe_dump(data, sort_keys=False), "utf-8")
    return file


def enter(commit: str, draws: Path = DRAWS) -> bool:
    """Add a draw to the list of all; False: it stands there."""
    text = draws.read_text("utf-8")
    if any(entry["commit"] == commit for entry in yaml.safe_load(text)["draws"] or []):
        return False
    line = f"  - {{commit: {commit}, seed: {seed_of(commit)}, result: not run yet}}\n"
    draws.write_text(text.replace("draws: []\n", "draws:\n") + line, "utf-8")
    return True


def main() -> None:
    """Write the campaign of a commit, and print its path."""
    parser = argparse.ArgumentParser(prog="python -m devkit.fusion.frozen", description=__doc__)
    parser.add_argument("--commit", required=True, help="the commit that froze the stack, in full")
    parser.add_argument("--out", type=Path, required=True, help="folder to write into")
    parser.add_argument("--quick", action="store_true", help="eight cases, one per street")
    options = parser.parse_args()
    try:
        file = write(options.commit, options.out.absolute(), quick=options.quick)
    except ValueError as error:
        parser.error(str(error))
    enter(options.commit)
    print(file)


if __name__ == "__main__":
    main()
