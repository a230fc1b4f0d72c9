"""Rows of an AutoDRIVE log -> KPI columns, scalars and a verdict.

KPIs that the logs do not hold (speed, acceleration, time to collision, lamps) are missing. Time is
the wall clock of the log.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from conductor.report.autodrive.layout import STEERING_MAX_RAD
from conductor.report.autodrive.logs import LogRow
from conductor.report.reading.rest import REST_MPS, Track
from schemas.files.autodrive_log import (
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
from schemas.files.kpi import DETECTION_FIELDS, SCALARS


@dataclass(frozen=True, slots=True)
class LogEnd:
    """What a log says about the end of its case."""

    outcome: str
    """``verdict`` or ``unresolved``."""
    verdict: str
    reason: str
    no_collision: bool | None
    """Whether there was no collision, by the study's rule; None: the log was cut off, so nobody
    knows."""


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


def judge(rows: list[LogRow], table: pa.Table, false_braking_m: float, log_s_min: float) -> LogEnd:
    """How the case of a log ended, by the rules of this simulator as far as a log can tell.

    The study's script never ends a log: it writes until the job's wall time is up, whatever the ego
    does. So a log without a collision decides its case only if it is complete and the ego rests at
    its end. Of the published egos that came to rest, many drove on later, up to 100 s after.

    Args:
        rows: of the log.
        table: the same rows as KPIs.
        false_braking_m: coming to rest further than this from the obstacle is false braking [m].
        log_s_min: a log without a collision that is shorter was cut off [s].
    """
    hit = next((row for row in rows if row.collisions), None)
    if hit is not None:
        reason = f"collision {hit.time_us / 1e6:.3f} s into the log"
        return LogEnd("verdict", "collision", reason, no_collision=False)
    track = Track.of(table)
    free = True if rows[-1].time_us >= 1e6 * log_s_min else None
    if undecided := _undecided(track, false_braking_m, log_s_min):
        return LogEnd("unresolved", "", undecided, free)
    end = f"{track.end_dtc_m():.2f} m from the obstacle"
    if track.began() is None:
        far = track.end_dtc_m() > false_braking_m
        reason = f"the ego never moved, {end}"
        return LogEnd("verdict", "false_braking" if far else "time_up", reason, free)
    far_m = track.first_rest_beyond_m(false_braking_m)
    if far_m is not None:
        reason = (
            f"came to rest {far_m:.2f} m from the obstacle; further than {false_braking_m:g} m "
            "is false braking"
        )
        return LogEnd("verdict", "false_braking", reason, free)
    return LogEnd("verdict", "pass", f"came to rest {end}", free)


def _undecided(track: Track, false_braking_m: float, log_s_min: float) -> str:
    """Why a log without a collision does not decide its case; empty: it does."""
    ends = f"the log ends after {track.time_s[-1]:.1f} s"
    speed_mps, dtc_m = track.end_speed_mps(), track.dtc_m[-1]
    if math.isnan(speed_mps):
        return f"{ends}, and its last rows do not say whether the ego moves"
    if speed_mps > REST_MPS:
        where = "at an unknown distance" if math.isnan(dtc_m) else f"{dtc_m:.2f} m"
        far_m = track.first_rest_beyond_m(false_braking_m)
        before = "" if far_m is None else f"; it had come to rest {far_m:.2f} m from it before"
        return (
            f"{ends} with the ego moving at {speed_mps:.2f} m/s, {where} from the obstacle{before}"
        )
    dtc_m = track.end_dtc_m()
    if math.isnan(dtc_m):
        return f"{ends} with the ego at rest at an unknown distance from the obstacle"
    if track.time_s[-1] < log_s_min:
        return (
            f"{ends} with the ego at rest {dtc_m:.2f} m from the obstacle; a log shorter "
            f"than {log_s_min:g} s was cut off, and the ego may have driven on"
        )
    return ""
