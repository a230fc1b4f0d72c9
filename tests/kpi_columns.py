"""KPI columns and scalars of a few open-loop drives, as digests: which bytes a change has moved.

``python tests/kpi_columns.py --out tests/golden/kpi_columns.json`` writes the golden file. Run it
at the commit *before* a change that may only add columns, not after it.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from case_changes import changed

from schemas.case import Case
from schemas.messages import Command, Detection, Lights
from schemas.plan import expand, parse_campaign
from twin.base.software import device_class
from twin.records.kpi_file import canonical, kpi_table
from twin.rig.engine import Engine
from twin.rig.slot import Finished

Policy = dict[str, float]
"""``throttle`` until ``brake_s``, then ``brake``; ``steering`` all the way."""

DRIVES: dict[str, list[tuple[str, dict[str, Any], Policy]]] = {
    "downtown": [
        ("stops", {"ego_start_m": 30.0, "ego_speed_mps": 9.0}, {"brake": 0.8, "brake_s": 0.6}),
        ("hits", {"ego_start_m": 12.0, "ego_speed_mps": 9.0}, {"throttle": 0.2}),
        ("rests-far", {"ego_start_m": 60.0, "ego_speed_mps": 6.0}, {"brake": 1.0, "brake_s": 0.0}),
        ("rolls", {"ego_start_m": 60.0, "ego_speed_mps": 5.0, "duration_s": 2.0}, {}),
        ("stands", {"ego_start_m": 60.0, "duration_s": 1.5}, {"brake": 1.0, "brake_s": 0.0}),
        ("swerves", {"ego_start_m": 50.0, "ego_speed_mps": 9.0}, {"steering": -0.05}),
        (
            "keeps-its-lane",
            {"type": "lane_keeping", "distance_m": 15.0, "ego_speed_mps": 8.0},
            {"throttle": 0.1},
        ),
        (
            "leaves-its-lane",
            {"type": "lane_keeping", "distance_m": 40.0, "ego_speed_mps": 8.0},
            {"steering": 0.05},
        ),
    ],
    "crossing": [
        (
            "meets-a-pedestrian",
            {"ego_start_m": 90.0, "ego_speed_mps": 7.0, "duration_s": 9.0},
            {"throttle": 0.12},
        ),
        ("stops", {"ego_start_m": 40.0, "ego_speed_mps": 8.0}, {"brake": 0.4, "brake_s": 1.0}),
    ],
}
WEATHERS = ("clear", "heavy_rain")


FORMULA = "always (ttc_s > 1.0 or speed_mps < 0.5)"
"""Formula of all drives."""


def cases(scene: str) -> list[tuple[Case, Policy]]:
    """The drives of a scene, each in its weather."""
    found = []
    for number, (name, scenario, policy) in enumerate(DRIVES[scene]):
        campaign, mistakes = parse_campaign(
            {
                "campaign": "columns",
                "seed": 5,
                "camera": {"width": 32, "height": 18, "hz": 10},
                "scenario": {"scene": scene, "duration_s": 6.0, "standstill_s": 0.5, **scenario},
                "autonomy": {"latency_ms": 40},
                "matrix": {"weather": [WEATHERS[number % 2]], "time_of_day": ["13:00"]},
            }
        )
        assert campaign is not None, mistakes
        found.append((changed(expand(campaign)[0], id=f"{scene}-{name}", formula=FORMULA), policy))
    return found


def drive(scene: str) -> dict[str, Finished]:
    """Every drive of a scene to its end, by case id."""
    drives = cases(scene)
    engine = Engine(drives[0][0], len(drives))
    for slot, (case, _) in enumerate(drives):
        engine.reset(slot, case)
    ended = {}
    while engine.active.any():
        engine.sense()
        commands = [
            _command(engine, slot, policy) if engine.active[slot] else None
            for slot, (_, policy) in enumerate(drives)
        ]
        for finished in engine.step(commands):
            ended[drives[finished.slot][0].id] = finished
    engine.close()
    return ended


def _command(engine: Engine, slot: int, policy: Policy) -> Command:
    at_s = float(engine.sim_time_ns[slot]) / 1e9
    brakes = at_s >= policy.get("brake_s", 1e9)
    return Command(
        slot,
        0,
        int(engine.tick[slot]),
        0.0 if brakes else policy.get("throttle", 0.0),
        policy["brake"] if brakes else 0.0,
        policy.get("steering", 0.0),
        aeb=brakes,
        lights=Lights(high=True, indicators=1),
        detections=[Detection("car", 0.5, at_s, 2.0, 3.0, 4.0)] if at_s > 0.3 else [],
    )


def described(finished: Finished) -> dict[str, Any]:
    """Verdict, scalars and columns of a drive; of a column its digest, and of numbers the first,
    last and mean value for other processors."""
    table = kpi_table(finished.table.to_lists())
    stream = b"".join(canonical(table))
    return {
        "verdict": finished.verdict,
        "scalars": finished.scalars,
        "stream": {"bytes": len(stream), "sha256": hashlib.sha256(stream).hexdigest()},
        "columns": {name: _column(table.column(name)) for name in table.column_names},
    }


def _column(column: pa.ChunkedArray) -> dict[str, Any]:
    values = column.to_pylist()
    found: dict[str, Any] = {
        "type": str(column.type),
        # `repr` of a float says every bit of it.
        "sha256": hashlib.sha256(repr(values).encode()).hexdigest(),
        "nulls": column.null_count,
    }
    known = [value for value in values if isinstance(value, (int, float))]
    if known:
        numbers = np.array(known, float)
        found["of"] = [float(numbers[0]), float(numbers[-1]), float(numbers.mean())]
    return found


def measure() -> dict[str, Any]:
    """The content of the golden file."""
    ended = {name: finished for scene in DRIVES for name, finished in drive(scene).items()}
    return {
        "device_class": device_class("cpu"),
        "cases": {name: described(finished) for name, finished in ended.items()},
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="file to write, .json")
    out: Path = parser.parse_args().out
    out.write_text(json.dumps(measure(), indent=1) + "\n")
