"""Lane keeping on the winding road that ships: rows as they were, whatever the slots.

After a wanted change: ``UPDATE_GOLDEN=1 pytest tests/golden/test_lane_on_roads.py``, then read the
difference of the JSON file.
"""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from schemas.case import Case
from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from twin.rig.engine import Engine
from twin.rig.slot import Finished
from twin.vehicle.columns import COLUMN
from twin.world.road_scene import road_lane, road_map
from twin.world.scene import shipped_roads

pytestmark = pytest.mark.slow

FILE = Path(__file__).with_name("lane_on_roads.json")
EVERY = 20
"""Ticks between two golden rows."""
TOLERANCE = 1e-9
"""Relative; other processors round differently."""


def case_of(speed_mps: float, distance_m: float) -> Case:
    campaign, mistakes = parse_campaign(
        {
            "campaign": "golden",
            "camera": {"width": 32, "height": 18, "hz": 1},
            "scenario": {
                "type": "lane_keeping",
                "scene": "rural",
                "ego_speed_mps": speed_mps,
                "distance_m": distance_m,
                "duration_s": 60.0,
            },
            "matrix": {"weather": ["clear"]},
        }
    )
    assert campaign is not None, mistakes
    return expand(campaign)[0]


def driven(engine: Engine, slot: int, tick: int) -> Command:
    """A driver who knows the lane: curvature ahead, less what the car is beside and askew."""
    lane = road_lane(str(shipped_roads()["rural"])).path
    row = engine.state[slot]
    x_m, y_m, yaw_rad, speed_mps = (row[COLUMN[n]] for n in ("x_m", "y_m", "yaw_rad", "speed_mps"))
    place = lane.locate(x_m, y_m)
    askew = float(np.angle(np.exp(1j * (yaw_rad - place.heading_rad))))
    curvature = float(lane.at(float(place.s_m) + 4.0).curvature_per_m)
    steering = 3.09 * curvature - 0.05 * float(place.lateral_m) - 0.4 * askew
    return Command(slot, 1, tick, 0.35 if speed_mps < 14.0 else 0.0, 0.0, steering)


def run(cases: list[Case]) -> list[tuple[Finished, str]]:
    """Cases side by side, each with a digest of its rows."""
    engine = Engine(cases[0], len(cases))
    for slot, case in enumerate(cases):
        engine.reset(slot, case)
    done: dict[int, Finished] = {}
    while engine.active.any():
        engine.sense()
        commands = [
            driven(engine, slot, int(engine.tick[slot])) if engine.active[slot] else None
            for slot in range(len(cases))
        ]
        done.update((ended.slot, ended) for ended in engine.step(commands))
    engine.close()
    outcomes = []
    for slot in range(len(cases)):
        digest = hashlib.sha256()
        for name, column in done[slot].table.columns.items():
            digest.update(name.encode() + repr(column.values.tolist()).encode())
        outcomes.append((done[slot], digest.hexdigest()))
    return outcomes


def rows_of(ended: Finished) -> dict[str, Any]:
    names = ("x_m", "y_m", "z_m", "yaw_rad", "speed_mps", "lateral_error_m")
    columns = ended.table.columns
    return {
        "verdict": ended.verdict,
        "scalars": {
            name: ended.scalars[name]
            for name in ("distance_m", "lateral_error_rms_m", "lateral_error_max_m")
        },
        "rows": {name: columns[name].values[::EVERY].tolist() for name in names if name in columns},
    }


def test_rows_are_those_recorded_and_equal_in_every_slot() -> None:
    cases = [case_of(12.0, 420.0), case_of(9.0, 150.0), case_of(12.0, 420.0)]
    together = run(cases)
    alone = run(cases[:1])
    assert together[0][1] == together[2][1] == alone[0][1]
    assert together[1][1] != alone[0][1]
    rows = rows_of(alone[0][0])
    if os.environ.get("UPDATE_GOLDEN"):
        FILE.write_text(json.dumps(rows, indent=1) + "\n")
    golden = json.loads(FILE.read_text())
    assert rows["verdict"] == golden["verdict"] == "pass"
    assert rows["scalars"] == pytest.approx(golden["scalars"], rel=TOLERANCE)
    assert rows["rows"].keys() == golden["rows"].keys()
    for name, values in golden["rows"].items():
        assert rows["rows"][name] == pytest.approx(values, rel=TOLERANCE, abs=1e-9), name
    assert golden["scalars"]["lateral_error_max_m"] < 0.1


def test_the_error_is_the_distance_from_the_lane_of_the_file() -> None:
    rows = json.loads(FILE.read_text())["rows"]
    frame = next(iter(road_map(str(shipped_roads()["rural"])).frames.values()))
    place = frame.locate(np.array(rows["x_m"]), np.array(rows["y_m"]))
    centre = frame.lane_pose(-1, place.s_m)
    off = np.hypot(centre.x_m - rows["x_m"], centre.y_m - rows["y_m"])
    assert np.abs(np.abs(rows["lateral_error_m"]) - off).max() < 0.002
