"""A made-up attempt whose verdict follows from its rows, for benches of who takes attempts in.

``python -m twin.bench.attempt`` prints it as JSON: KPI columns, the judge's record, and what a
worker commits of it. Nothing is simulated and no Warp is loaded.
"""

from __future__ import annotations

import sys
from typing import Any

import msgspec
import numpy as np

from schemas import SCHEMA_VERSION
from schemas.files.judging import JudgeRecord
from schemas.sections.scenario import Scenario
from twin.kpi.judge import TableRows
from twin.kpi.judge_record import lane_record, state_of, surroundings_of
from twin.kpi.verdict import judge, names, scalars
from twin.records.kpi_file import kpi_table
from twin.road.lane import straight
from twin.scenario.families import replay

TICKS = 200
"""Rows: 10 s at 20 Hz."""
_TICK_S = 0.05
_OBSTACLE_M = 60.0
_HALF_LENGTH_M, _HALF_WIDTH_M = 2.25, 0.9
_SPEED_MPS, _BRAKING_MPS2, _BRAKES_AT_S = 8.0, 4.0, 5.0


def attempt() -> dict[str, Any]:
    """Columns of ``kpi.parquet``, ``judge.json`` for the default scenario, and the result."""
    columns, record = _columns(), _record()
    state = state_of(record)
    rows: Any = TableRows(kpi_table(columns))
    run = replay(record.scenario, surroundings_of(record), rows)
    judgement = judge(rows, state, run, None)
    return {
        "columns": columns,
        "record": record,
        "result": {
            "verdict": judgement.verdict,
            "reasons": judgement.reasons,
            "scalars": scalars(rows, state, run, None),
            "names": names(rows, state, None),
        },
    }


def _columns() -> dict[str, list[Any]]:
    """A car drives at 8 m/s, sees the obstacle, and brakes."""
    tick = np.arange(TICKS)
    braking_s = np.maximum(tick * _TICK_S - _BRAKES_AT_S, 0.0)
    braking_s = np.minimum(braking_s, _SPEED_MPS / _BRAKING_MPS2)
    speed_mps = _SPEED_MPS - _BRAKING_MPS2 * braking_s
    x_m = _SPEED_MPS * np.minimum(tick * _TICK_S, _BRAKES_AT_S)
    x_m = x_m + _SPEED_MPS * braking_s - _BRAKING_MPS2 / 2 * braking_s**2
    dtc_m = _OBSTACLE_M - x_m - 2 * _HALF_LENGTH_M
    aeb = braking_s > 0
    car = {"label": "car", "confidence": 0.75, "x_px": 301.5, "y_px": 170.25}
    columns: dict[str, list[Any]] = {
        "tick": tick.tolist(),
        "sim_time_ns": (tick * round(_TICK_S * 1e9)).tolist(),
        "x_m": x_m.tolist(),
        "y_m": (0.01 * np.sin(tick / 7)).tolist(),
        "yaw_rad": (0.001 * np.cos(tick / 7)).tolist(),
        "speed_mps": speed_mps.tolist(),
        "accel_mps2": np.gradient(speed_mps, _TICK_S).tolist(),
        "dtc_m": dtc_m.tolist(),
        "ttc_s": (dtc_m / np.maximum(speed_mps, 0.1)).tolist(),
        "collisions": [0] * TICKS,
        "throttle": np.where(aeb, 0.0, 0.3).tolist(),
        "brake": aeb.astype(float).tolist(),
        "steering_rad": (0.002 * np.sin(tick / 5)).tolist(),
        "aeb": aeb.tolist(),
        "headlights": [0] * TICKS,
        "indicators": [0] * TICKS,
        "nearest_m": dtc_m.tolist(),
        "nearest_object": ["obstacle"] * TICKS,
        "detections": [[{**car, "width_px": 60.0, "height_px": 41.0}]] * TICKS,
    }
    return columns


def _record() -> JudgeRecord:
    return JudgeRecord(
        v=SCHEMA_VERSION,
        case="",
        scenario=Scenario(),
        collisions=0,
        impact_speed_mps=0.0,
        impact_step=-1,
        moved=True,
        target=(_OBSTACLE_M, 0.0, 0.0, _HALF_LENGTH_M, _HALF_WIDTH_M),
        centre_offset_m=0.0,
        half_length_m=_HALF_LENGTH_M,
        half_width_m=_HALF_WIDTH_M,
        lane=lane_record(straight(-10.0, 200.0)),
    )


if __name__ == "__main__":
    sys.stdout.buffer.write(msgspec.json.encode(attempt()) + b"\n")
