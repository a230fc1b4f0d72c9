"""Ultrasonic rangers in the bumpers."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from schemas.kinds.sensor import MadeUpDrive, SensorConfig, SensorKind

COLUMNS = ("distance_m", "bearing_rad")
"""Columns of an echo, float32: distance from the transducer, and where that one looks in the
vehicle's axes, left of forward."""

TRANSDUCERS = 8
"""Four in the front bumper from right to left, then four in the rear bumper from left to right."""


class Ultrasonic(SensorConfig, frozen=True):
    """Eight ultrasonic rangers, four in each bumper."""

    range_m: Annotated[float, Meta(gt=0, le=10)] = 5.0
    """Nothing farther away gives an echo [m]."""


def _made_up(drive: MadeUpDrive) -> list[list[float]]:
    gap_m = 20.0 - drive.speed_mps * drive.time_s
    return [[gap_m, 0.0]] if 0.2 < gap_m < 5.0 else []


KIND = SensorKind(
    name="ultrasonic",
    doc="Distances of the nearest things before and behind the bumpers.",
    config=Ultrasonic,
    columns=COLUMNS,
    columns_name="ULTRASONIC_COLUMNS",
    dtype="<f4",
    rows_max=TRANSDUCERS,
    implementation="twin.sensors.ultrasonic.ranger:Ranger",
    made_up=_made_up,
)
