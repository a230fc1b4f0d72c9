"""Sixteen pictures for an independent reader, and what is in them.

    PYTHONPATH=. python tests/reader_frames.py FOLDER --seed 7

Every weather once by day and once by night, at random places, unlabelled and shuffled. The answers
go beside the folder, not into it. docs/reading.md holds what readers said.
"""

from __future__ import annotations

import argparse
import json
import random
from pathlib import Path

import cv2

from schemas.messages import OBJECT_CLASSES, Command
from schemas.names import WEATHERS
from schemas.plan import expand, parse_campaign
from twin.rig.engine import Engine
from twin.snapshot import usual_lights

DAY, NIGHT = ("09:00", "13:00", "16:30", "12:00", "08:00"), ("05:00", "21:00", "23:30")
PIXELS_MIN = 150
"""Objects that show fewer pixels are not asked for."""


def frame(number: int, weather: str, hour: str, rng: random.Random, folder: Path) -> dict:
    """Write one picture; its answers."""
    distance_m, ticks = rng.choice((25, 40, 60, 90, 130, 170)), rng.randint(1, 24)
    campaign, mistakes = parse_campaign(
        {
            "campaign": "reading",
            "seed": number,
            "camera": {"width": 960, "height": 540},
            "scenario": {"ego_start_m": distance_m, "ego_speed_mps": 8.0},
            "matrix": {"weather": [weather], "time_of_day": [hour]},
        }
    )
    assert campaign is not None, mistakes
    (case,) = expand(campaign)
    engine = Engine(case, 1)
    engine.reset(0, case)
    lights = usual_lights(weather, 1.0 if hour in NIGHT else 50_000.0)
    for tick in range(ticks):
        engine.sense()
        engine.step([Command(0, 0, tick, 0.3, 0.0, 0.0, lights=lights)])
    seen = engine.sense()
    image = cv2.cvtColor(seen["camera"].values[0], cv2.COLOR_RGB2BGR)
    cv2.imwrite(str(folder / f"frame-{number:02d}.png"), image)
    boxes = seen["boxes"].values[0, : seen["boxes"].count[0]]
    kinds = {OBJECT_CLASSES[int(box[0])] for box in boxes if box[5] >= PIXELS_MIN}
    return {"frame": number, "weather": weather, "time": hour, "objects": sorted(kinds)}


def main() -> None:
    """Write pictures and answers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    rng = random.Random(options.seed)
    wanted = [(w, rng.choice(hours)) for hours in (DAY, NIGHT) for w in WEATHERS]
    rng.shuffle(wanted)
    answers = [frame(i + 1, w, hour, rng, options.folder) for i, (w, hour) in enumerate(wanted)]
    path = options.folder.with_name(f"{options.folder.name}-answers.json")
    path.write_text(json.dumps(answers, indent=1))


if __name__ == "__main__":
    main()
