"""Names: application and recording ids, entity paths, files. Ids hold [A-Za-z0-9_-] only."""

from __future__ import annotations

import hashlib
import re

from schemas.files import recording

CASE_APP = "twin_case"
"""Application id of a single case's recording; blueprints belong to it."""
OVERVIEW_APP = "twin_overview"
"""Application id of the live overview."""

RECORDING_FILE = recording.RECORDING_FILE
RECORDING_NOTE = recording.RECORDING_NOTE
"""Says whether the recording beside it is complete; absent: it is not."""
KPI_FILE = "kpi.parquet"

SIM_TIME = "sim_time"
"""Timeline of sim time since reset (a duration)."""
TICK = "tick"
"""Timeline of case ticks."""
WALL = "wall"
"""Timeline of the live overview (a timestamp)."""

WORLD = "world"
STREET = "world/street"
OBSTACLE = "world/obstacle"
PARKED = "world/parked"
BUILDINGS = "world/buildings"
EGO = "world/ego"
EGO_BODY = "world/ego/body"
CAMERA = "world/ego/camera"
DETECTIONS = "world/ego/camera/detections"
DETECTIONS_FAR = "world/ego/camera/detections_far"
TRIGGER = "world/ego/camera/trigger"
TRUTH = "world/ego/camera/truth"
SCENE = "world/scene"
MOVERS = "world/movers"
TRAIL = "world/trail"
GAP = "world/gap"
SPEED = "metrics/speed"
DTC = "metrics/dtc"
TTC = "metrics/ttc"
ACCEL = "metrics/accel"
THROTTLE = "command/throttle"
BRAKE = "command/brake"
AEB = "command/aeb"
READINGS = "sensors"
"""Plots of sensors with a row of numbers lie below, by name and column."""
PLANNER = "planner"
EVENTS = "events"
SUMMARY = "summary"
MOSAIC = "mosaic"
TILES = "mosaic/tiles"
CASES = "cases"

THROUGHPUT = "campaign/cases_per_min"
RUNNING = "campaign/running"
WORKERS_PRESENT = "campaign/workers"
WORKERS = "workers"
"""A plot per worker lies below."""

_ALLOWED = re.compile(r"[^A-Za-z0-9_-]")


def safe_id(*parts: str) -> str:
    """Parts joined by ``-``; if a character had to be replaced, a digest keeps ids apart."""
    text = "-".join(parts)
    safe = _ALLOWED.sub("_", text)
    if safe == text:
        return text
    return f"{safe}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def sensor(message: str) -> str:
    """Entity path of the sensor whose messages are called ``message``, e.g. ``lidar.roof``."""
    return f"{EGO}/{message.replace('.', '_')}"


def reading(sensor_name: str, column: str) -> str:
    """Entity path of one number of a sensor's rows."""
    return f"{READINGS}/{sensor_name}/{column}"


def grid(sensor_name: str) -> str:
    """Entity path of the picture of a sensor's grid: no camera sees it, so it is not on the ego."""
    return f"{READINGS}/{sensor_name}"


def recording_id(campaign: str, case: str, attempt: int) -> str:
    """Recording id of one attempt."""
    return safe_id(campaign, case, str(attempt))
