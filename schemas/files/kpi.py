"""Key performance indicators: one row per control tick, and the scalars of a case.

A row holds the state at the tick's time and the command computed from that tick's frames. Command
columns are null in the last row (the case has ended, nothing was asked). Missing is null, never 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

ColumnType = Literal["bool", "int32", "int64", "float64", "detections", "name"]


@dataclass(frozen=True, slots=True)
class ColumnDeclaration:
    """One KPI column; ``detections`` is a list of (label, confidence, x, y, width, height), a
    ``name`` what the scene calls an object."""

    name: str
    type: ColumnType
    unit: str
    doc: str
    nullable: bool = False


KPI_COLUMNS: tuple[ColumnDeclaration, ...] = (
    ColumnDeclaration("tick", "int32", "", "Case tick, 0 at reset"),
    ColumnDeclaration("sim_time_ns", "int64", "ns", "Sim time since reset"),
    ColumnDeclaration("x_m", "float64", "m", "Ego position, world x (along the street)"),
    ColumnDeclaration("y_m", "float64", "m", "Ego position, world y (left)"),
    ColumnDeclaration("yaw_rad", "float64", "rad", "Ego heading"),
    ColumnDeclaration("speed_mps", "float64", "m/s", "Ego speed, forward"),
    ColumnDeclaration("accel_mps2", "float64", "m/s^2", "Ego acceleration, forward"),
    ColumnDeclaration(
        "dtc_m", "float64", "m", "Distance to collision: ego hull to obstacle hull", True
    ),
    ColumnDeclaration(
        "ttc_s", "float64", "s", "Time to collision at constant speed", nullable=True
    ),
    ColumnDeclaration("collisions", "int32", "", "Collisions of the ego so far"),
    ColumnDeclaration(
        "lateral_error_m",
        "float64",
        "m",
        "Middle of the rear axle left of the lane's centre; lane_keeping only",
        nullable=True,
    ),
    ColumnDeclaration("throttle", "float64", "", "Throttle command", nullable=True),
    ColumnDeclaration("brake", "float64", "", "Brake command", nullable=True),
    ColumnDeclaration("steering_rad", "float64", "rad", "Road-wheel angle command", nullable=True),
    ColumnDeclaration("aeb", "bool", "", "AEB trigger", nullable=True),
    ColumnDeclaration("headlights", "int32", "", "Headlight code 0-11 of AutoDRIVE", nullable=True),
    ColumnDeclaration("indicators", "int32", "", "0 off, 1 left, 2 right, 3 hazard", nullable=True),
    ColumnDeclaration("detections", "detections", "px", "Detections of the stack", nullable=True),
    # Columns are added behind these: files of earlier versions end here, and keep their bytes.
    ColumnDeclaration(
        "nearest_m",
        "float64",
        "m",
        "Distance from the ego's hull to the nearest of all others: obstacle, parked and scripted "
        "vehicles, people, buildings, posts",
        nullable=True,
    ),
    ColumnDeclaration("nearest_object", "name", "", "Whose hull that is", nullable=True),
    ColumnDeclaration(
        "nearest_ttc_s",
        "float64",
        "s",
        "Least time until the ego's hull touches another, if all go straight on at constant "
        "velocity; null: it would touch none",
        nullable=True,
    ),
    ColumnDeclaration("nearest_ttc_object", "name", "", "Whose hull that is", nullable=True),
)

SCALARS: tuple[ColumnDeclaration, ...] = (
    ColumnDeclaration("sim_time_s", "float64", "s", "Sim time at the end of the case"),
    ColumnDeclaration("ticks", "int32", "", "Control ticks"),
    ColumnDeclaration("dtc_min_m", "float64", "m", "Smallest distance to collision", nullable=True),
    ColumnDeclaration(
        "dtc_end_m", "float64", "m", "Distance to collision at the end", nullable=True
    ),
    ColumnDeclaration(
        "aeb_time_s", "float64", "s", "Sim time of the first AEB trigger", nullable=True
    ),
    ColumnDeclaration(
        "aeb_dtc_m", "float64", "m", "Distance at the first AEB trigger", nullable=True
    ),
    ColumnDeclaration(
        "aeb_ttc_s", "float64", "s", "Time to collision at the first AEB trigger", nullable=True
    ),
    ColumnDeclaration(
        "impact_speed_mps", "float64", "m/s", "Speed at the first collision", nullable=True
    ),
    ColumnDeclaration("decel_peak_mps2", "float64", "m/s^2", "Peak deceleration"),
    ColumnDeclaration("speed_max_mps", "float64", "m/s", "Highest speed"),
    ColumnDeclaration("collisions", "int32", "", "Collisions of the ego"),
    ColumnDeclaration(
        "distance_m", "float64", "m", "Way driven along the lane; lane_keeping", nullable=True
    ),
    ColumnDeclaration(
        "lateral_error_rms_m",
        "float64",
        "m",
        "Root mean square of the lateral error; lane_keeping",
        nullable=True,
    ),
    ColumnDeclaration(
        "lateral_error_max_m", "float64", "m", "Largest of it; lane_keeping", nullable=True
    ),
    ColumnDeclaration(
        "nearest_min_m",
        "float64",
        "m",
        "Smallest distance to anything; 0: collision",
        nullable=True,
    ),
    ColumnDeclaration(
        "nearest_ttc_min_s", "float64", "s", "Least time to any collision", nullable=True
    ),
    ColumnDeclaration(
        "hit_hull",
        "int32",
        "",
        "Which hull of the object was hit first, from 1; null: no collision",
        nullable=True,
    ),
)

NAMES: tuple[ColumnDeclaration, ...] = (
    ColumnDeclaration("hit_object", "name", "", "What the ego hit first", nullable=True),
    ColumnDeclaration("hit_class", "name", "", "Its class", nullable=True),
    ColumnDeclaration("nearest_object", "name", "", "What the ego came nearest to", nullable=True),
    ColumnDeclaration(
        "nearest_ttc_object", "name", "", "What it would have hit soonest", nullable=True
    ),
)
"""Scalars of a case that are names; a missing one is left out."""

DETECTION_FIELDS = ("label", "confidence", "x_px", "y_px", "width_px", "height_px")

HEADLIGHTS = (
    ("off", ""),
    ("low beam", "low"),
    ("high beam", "high"),
    ("parking", "parking"),
    ("fog", "fog"),
    ("low beam, parking", "low parking"),
    ("low beam, fog", "low fog"),
    ("high beam, parking", "high parking"),
    ("high beam, fog", "high fog"),
    ("parking, fog", "parking fog"),
    ("low beam, parking, fog", "low parking fog"),
    ("high beam, parking, fog", "high parking fog"),
)
"""Headlight codes 0 to 11 as AutoDRIVE publishes them, in ``opencav_aeb.py`` of
AutoDRIVE-Simulator-HPC (0 disabled, 1 low beam, 2 high beam, 3 parking, 4 fog, 5 = 1 + 3,
6 = 1 + 4, 7 = 2 + 3, 8 = 2 + 4, 9 = 3 + 4, 10 = 1 + 3 + 4, 11 = 2 + 3 + 4): name and lamps."""

INDICATORS = ("off", "left", "right", "hazard")
"""Indicator codes 0 to 3, of the same source."""

_CODES = {frozenset(lamps.split()): code for code, (_, lamps) in enumerate(HEADLIGHTS)}


def headlight_code(low: bool, high: bool, parking: bool, fog: bool) -> int:
    """AutoDRIVE's code of a lamp combination; high beam wins over low beam."""
    burning = {"low": low and not high, "high": high, "parking": parking, "fog": fog}
    return _CODES[frozenset(lamp for lamp, on in burning.items() if on)]
