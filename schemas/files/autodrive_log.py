"""The AutoDRIVE study's logs: how files are named, and which columns they have.

A folder holds ``config.json`` with all cases, and per batch a folder ``batch_N`` with one
``aeb_metrics_sim_inst_M.csv`` per simulator instance, or ``batch_N.tar.gz`` with that folder in it.
"""

from __future__ import annotations

import re

CONFIG_FILE = "config.json"
LOG_BYTES_MAX = 64 << 20
"""A larger file is no log of this kind [bytes]; the published ones have 60 kB."""

TIMESTAMP = "Timestamp"
TIME_OF_DAY = "Time of Day (min)"
WEATHER = "Weather ID (#)"
MODEL = "Model"
LABEL = "Label"
CONFIDENCE = "Confidence (%)"
SIZE = "Size (px^2)"
AEB = "AEB (bool)"
DTC = "DTC (m)"
THROTTLE = "Throttle (%)"
STEERING = "Steering (%)"
BRAKE = "Brake (%)"
HANDBRAKE = "Handbrake (%)"
POS_X, POS_Y, POS_Z = "PosX (m)", "PosY (m)", "PosZ (m)"
ROT_X, ROT_Y, ROT_Z = "RotX (rad)", "RotY (rad)", "RotZ (rad)"
COLLISIONS = "Collisions (#)"

COLUMNS = (
    *(TIMESTAMP, TIME_OF_DAY, WEATHER, MODEL, LABEL, CONFIDENCE, SIZE, AEB, DTC, THROTTLE),
    *(STEERING, BRAKE, HANDBRAKE, POS_X, POS_Y, POS_Z, ROT_X, ROT_Y, ROT_Z, COLLISIONS),
)
"""The columns in their order. Throttle, steering, brake and handbrake are shares of 1 in spite of
their names."""

_LOG = re.compile(r"batch_([1-9]\d{0,5})/aeb_metrics_sim_inst_([1-9]\d{0,5})\.csv", re.ASCII)


def log_name(batch: int, instance: int) -> str:
    """Path of a log in the folder; batch and instance count from 1."""
    return f"batch_{batch}/aeb_metrics_sim_inst_{instance}.csv"


def parse_log_name(name: str) -> tuple[int, int] | None:
    """Batch and instance of a log by its path in the folder; None: the path is not that of a log.

    Absolute paths, and paths with ``..`` in them, are none.
    """
    match = _LOG.fullmatch(name)
    return (int(match[1]), int(match[2])) if match else None
