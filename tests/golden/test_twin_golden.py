"""The engine replays recorded figures: scalars of an open-loop drive and mean colours of pictures.

After a wanted change: ``UPDATE_GOLDEN=1 pytest tests/golden/test_twin_golden.py``, then read the
difference of the JSON file.
"""

import json
import os
from pathlib import Path

import pytest

from schemas.messages import Command, Lights
from schemas.plan import expand, parse_campaign
from twin.rig.engine import Engine

FILE = Path(__file__).with_name("twin_engine.json")
GRAY_TOLERANCE = 1.0  # of 255
SCALAR_TOLERANCE = 1e-9  # relative; other processors round differently


def measure():
    campaign, mistakes = parse_campaign(
        {
            "campaign": "golden",
            "camera": {"width": 64, "height": 36, "hz": 10},
            "scenario": {"ego_start_m": 40.0, "ego_speed_mps": 9.0, "duration_s": 8.0},
            "autonomy": {"latency_ms": 40},
            "matrix": {
                "weather": ["clear", "heavy_fog", "heavy_rain", "light_snow"],
                "time_of_day": ["05:00", "12:00"],
            },
        }
    )
    assert campaign is not None, mistakes
    cases = expand(campaign)
    engine = Engine(cases[0], len(cases))
    for slot, case in enumerate(cases):
        engine.reset(slot, case)
    found = {case.id: {} for case in cases}
    while engine.active.any():
        sensors = engine.sense()
        commands = [None] * len(cases)
        for slot, case in enumerate(cases):
            if not engine.active[slot]:
                continue
            tick = int(engine.tick[slot])
            if tick == 10:
                image = sensors["camera"].values[slot].astype(float)
                found[case.id]["mean_rgb"] = image.mean(axis=(0, 1)).round(3).tolist()
                found[case.id]["boxes"] = int(sensors["boxes"].count[slot])
            brake = 0.8 if tick >= 40 else 0.0
            lights = Lights(high=True)
            commands[slot] = Command(slot, 0, tick, 0.0, brake, 0.0, lights=lights)
        for ended in engine.step(commands):
            record = found[cases[ended.slot].id]
            record["verdict"] = ended.verdict
            record["scalars"] = ended.scalars
    return found


def test_golden():
    found = measure()
    if os.environ.get("UPDATE_GOLDEN"):
        FILE.write_text(json.dumps(found, indent=1) + "\n")
    golden = json.loads(FILE.read_text())
    assert found.keys() == golden.keys()
    for name, expected in golden.items():
        assert found[name]["verdict"] == expected["verdict"], name
        assert found[name]["boxes"] == expected["boxes"], name
        assert found[name]["mean_rgb"] == pytest.approx(expected["mean_rgb"], abs=GRAY_TOLERANCE)
        for scalar, value in expected["scalars"].items():
            wanted = value if value is None else pytest.approx(value, rel=SCALAR_TOLERANCE)
            assert found[name]["scalars"][scalar] == wanted, (name, scalar)
