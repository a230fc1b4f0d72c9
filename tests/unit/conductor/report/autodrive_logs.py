"""Folders of AutoDRIVE logs for tests: their columns, their formats, made-up drives."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from schemas.files.autodrive_log import COLUMNS, log_name

SIZE = 4
"""Instances of a batch, said in the configuration."""
ROWS_MIN = 131
"""Fewest rows of a log, one a second: it is complete."""
MODELS = ("yolov2", "yolov3-tiny")

Rows = list[dict[str, str]]


def config(models: tuple[str, ...] = MODELS) -> dict[str, Any]:
    """Per model two weathers by two times: a batch each."""
    return {
        "simulation_instances": [
            {"time_of_day": time, "weather_id": weather, "model": model}
            for model in models
            for weather in (1, 4)
            for time in (300, 780)
        ],
        "batch_size": SIZE,
    }


def drive(instance: dict[str, Any], *, brake_m: float = 30.0, stop_m: float = 20.0) -> Rows:
    """From 148 m at 1 m per row and second to ``stop_m``, with AEB from ``brake_m`` on; at 0 m it
    hits. Then it stands until the job's time is up."""
    rows = []
    distances = [148.0 - step for step in range(int(148 - stop_m) + 1)]
    stands = max(2, ROWS_MIN - len(distances))
    for second, dtc_m in enumerate([*distances, *[distances[-1]] * stands]):
        aeb = dtc_m <= brake_m
        rows.append(
            {
                "Timestamp": f"2024-03-18 16:{35 + second // 60}:{second % 60:02}.250000",
                "Time of Day (min)": str(instance["time_of_day"]),
                "Weather ID (#)": str(instance["weather_id"]),
                "Model": instance["model"],
                "Label": "car" if aeb else "",
                "Confidence (%)": "84.54" if aeb else "0.0",
                "Size (px^2)": "10672" if aeb else "",
                "AEB (bool)": str(int(aeb)),
                "DTC (m)": f"{dtc_m:.2f}",
                "Throttle (%)": "0.0" if aeb else "0.2",
                "Steering (%)": "0.0",
                "Brake (%)": str(float(aeb)),
                "Handbrake (%)": "0.0",
                "PosX (m)": "-208.24",
                "PosY (m)": f"{-dtc_m:.3f}",
                "PosZ (m)": "342.014",
                "RotX (rad)": "0.001",
                "RotY (rad)": "0.004",
                "RotZ (rad)": "1.802",
                "Collisions (#)": str(int(dtc_m <= 0)),
            }
        )
    return rows


def text(rows: Rows, columns: tuple[str, ...] = COLUMNS) -> str:
    """A log as the study's script writes it."""
    lines = [",".join(columns), *(",".join(row[name] for name in columns) for row in rows)]
    return "\n".join(lines) + "\n"


def places(data: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Log and case of every instance."""
    for number, instance in enumerate(data["simulation_instances"]):
        yield log_name(number // SIZE + 1, number % SIZE + 1), instance


def write_logs(
    folder: Path,
    data: dict[str, Any] | None = None,
    rows: Callable[[dict[str, Any]], Rows] = drive,
) -> dict[str, Any]:
    """Write configuration and logs; returns the configuration."""
    data = data or config()
    for name, instance in places(data):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text(rows(instance)))
    (folder / "config.json").write_text(json.dumps(data))
    return data
