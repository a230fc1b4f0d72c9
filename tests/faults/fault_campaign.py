"""The campaign of the fault table: many short cases of the real simulator with a tiny camera."""

from __future__ import annotations

from typing import Any

CASES = 16
"""Of one copy of the campaign."""

CAMPAIGN: dict[str, Any] = {
    "schema": 1,
    "campaign": "faults",
    "description": "Half-second cases with a tiny camera, for the table of faults",
    "seed": 16,
    "control_hz": 20,
    # A rig that hangs is seen within a fault; and no case is held guilty of what we do to it.
    "deadline_s": 30.0,
    "attempts_max": 100,
    "scenario": {
        "scene": "downtown",
        "vehicle": "opencav",
        "ego_start_m": 20,
        "ego_speed_mps": 12,
        "duration_s": 0.5,
        "standstill_s": 0.5,
    },
    "camera": {"name": "front_right", "width": 64, "height": 36, "hz": 20, "hfov_deg": 70},
    "autonomy": {
        "stack": "devkit.aeb:AebStack",
        "parameters": {"cruise_speed_mps": 12.0},
        "perception": {
            "yolov3": {"type": "ground_truth", "contrast_min": 0.05},
            "yolov2-tiny": {"type": "ground_truth", "contrast_min": 0.16},
        },
    },
    "matrix": {
        "model": ["yolov3", "yolov2-tiny"],
        "weather": ["clear", "heavy_fog", "heavy_rain", "heavy_snow"],
        "time_of_day": ["05:00", "13:00"],
    },
}
