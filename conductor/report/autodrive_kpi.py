"""Rows of an AutoDRIVE log -> KPI columns, scalars and a verdict.

KPIs that the logs do not hold (speed, acceleration, time to collision, lamps) are missing. Time is
the wall clock of the log. The verdict follows the rule of this simulator from what is there.
"""

from __future__ import annotations

import math
from typing import Any

from conductor.report.autodrive_layout import STEERING_MAX_RAD
from conductor.report.autodrive_logs import LogRow
from schemas.autodrive_log import (
    BRAKE,
    CONFIDENCE,
    DTC,
    POS_X,
    POS_Y,
    ROT_Z,
    SIZE,
    STEERING,
    THROTTLE,
)
from schemas.kpi import DETECTION_FIELDS, SCALARS

REST_MPS = 0.02
"""Slower than this between two rows is at rest; positions are logged in millimetres [m/s]."""
MOVED_M = 0.1
"""Further than this from its first place the ego has moved [m]."""


def kpi_columns(rows: list[LogRow]) -> dict[str, list[Any]]:
    """Columns of a KPI table; what a log does not hold is missing in every row."""

    def number(column: str) -> list[float]:
        return [row.numbers[column] for row in rows]

    def command(column: str, scale: float = 1.0) -> list[float | None]:
        return [None if math.isnan(v) else scale * v for v in number(column)]

    missing, unknown = [None] * len(rows), [math.nan] * len(rows)
    return {
        "tick": list(range(len(rows))),
        "sim_time_ns": [1000 * row.time_us for row in rows],
        "x_m": number(POS_X),
        "y_m": number(POS_Y),
        "yaw_rad": number(ROT_Z),
        "speed_mps": unknown,
        "accel_mps2": unknown,
        "dtc_m": number(DTC),
        "ttc_s": missing,
        "collisions": [row.collisions for row in rows],
        "lateral_error_m": missing,
        "throttle": command(THROTTLE),
        "brake": command(BRAKE),
        "steering_rad": command(STEERING, STEERING_MAX_RAD),
        "aeb": [row.aeb for row in rows],
        "headlights": missing,
        "indicators": missing,
        "detections": [_detections(row) for row in rows],
    }


def _detections(row: LogRow) -> list[dict[str, Any]]:
    """The box that the script looked at: of its place nothing is known, and only its area is
    logged, so it is one pixel high. Without a label the confidence means nothing."""
    size, percent = row.numbers[SIZE], row.numbers[CONFIDENCE]
    if not row.label or math.isnan(size):
        return []
    values = (row.label, percent / 100.0, math.nan, math.nan, size, 1.0)
    return [dict(zip(DETECTION_FIELDS, values, strict=True))]


def scalars(rows: list[LogRow]) -> dict[str, float | int | None]:
    """Scalar KPIs; None where the log does not hold them."""
    values: dict[str, float | int | None] = {column.name: None for column in SCALARS}
    distances = [row.numbers[DTC] for row in rows]
    known = [distance for distance in distances if not math.isnan(distance)]
    first = next((row for row in rows if row.aeb), None)
    values |= {
        "sim_time_s": rows[-1].time_us / 1e6,
        "ticks": len(rows) - 1,
        "dtc_min_m": min(known, default=None),
        "dtc_end_m": _present(distances[-1]),
        "collisions": rows[-1].collisions,
    }
    if first is not None:
        values["aeb_time_s"] = first.time_us / 1e6
        values["aeb_dtc_m"] = _present(first.numbers[DTC])
    return values


def _present(value: float) -> float | None:
    return None if math.isnan(value) else value


def judge(rows: list[LogRow], false_braking_m: float) -> tuple[str, str]:
    """Verdict and reason by the rule of this simulator: a collision, else any rest further than
    ``false_braking_m`` from the obstacle after the ego has moved, or never having moved there, is
    false braking, else it passes."""
    hit = next((row for row in rows if row.collisions), None)
    if hit is not None:
        return "collision", f"collision {hit.time_us / 1e6:.3f} s into the log"
    end_m = rows[-1].numbers[DTC]
    last_m = next((d for row in reversed(rows) if not math.isnan(d := row.numbers[DTC])), math.nan)
    end = "at an unknown distance" if math.isnan(end_m) else f"{end_m:.2f} m from the obstacle"
    start = _start(rows)
    moving = next((i for i, row in enumerate(rows) if _way_m(start, row) > MOVED_M), None)
    if moving is None:
        verdict = "false_braking" if last_m > false_braking_m else "pass"
        return verdict, f"the ego never moved, {end}"
    resting = False
    for before, row in zip(rows[moving:], rows[moving + 1 :], strict=False):
        resting = _way_m(before, row) <= REST_MPS * (row.time_us - before.time_us) / 1e6
        if resting and row.numbers[DTC] > false_braking_m:
            return "false_braking", (
                f"came to rest {row.numbers[DTC]:.2f} m from the obstacle; further than "
                f"{false_braking_m:g} m is false braking"
            )
    return "pass", f"came to rest {end}" if resting else f"the log ends {end}, the ego moving"


def _start(rows: list[LogRow]) -> LogRow:
    """The first row that another one can be compared with."""
    placed = [row for row in rows if not math.isnan(row.numbers[POS_X] + row.numbers[POS_Y])]
    known = [row for row in rows if not math.isnan(row.numbers[DTC])]
    return next((found[0] for found in (placed, known) if len(found) > 1), rows[0])


def _way_m(one: LogRow, two: LogRow) -> float:
    """Distance between the ego's places; by distance to the obstacle where a place is missing."""
    way = math.hypot(
        two.numbers[POS_X] - one.numbers[POS_X], two.numbers[POS_Y] - one.numbers[POS_Y]
    )
    return abs(two.numbers[DTC] - one.numbers[DTC]) if math.isnan(way) else way
