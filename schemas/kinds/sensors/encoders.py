"""Incremental encoders on the four wheels."""

from __future__ import annotations

import math
from typing import Annotated

from msgspec import Meta

from schemas.kinds.sensor import MadeUpDrive, SensorConfig, SensorKind

COLUMNS = ("front_left_ticks", "front_right_ticks", "rear_left_ticks", "rear_right_ticks")
"""Columns of the wheel encoders, int64 [S, 4]: ticks since reset, falling in reverse."""
_WHEEL_RADIUS_M = 0.36
"""Wheel radius of the made-up drive's car [m]."""


class Encoders(SensorConfig, frozen=True):
    """Incremental encoders on the four wheels: ticks = floor(ppr x cgr x revolutions)."""

    ppr: Annotated[int, Meta(ge=1, le=1_000_000)] = 44
    """Pulses per revolution of the encoder's shaft (44: a common tone wheel of the wheel speed
    sensors of ABS, stated so in Hyundai's shop manual of the Tiburon 2007)."""
    cgr: Annotated[float, Meta(gt=0, le=1000)] = 1.0
    """Cumulative gear ratio: revolutions of the encoder's shaft per revolution of the wheel [-]."""


def _made_up(drive: MadeUpDrive) -> list[float]:
    turns = drive.speed_mps * drive.time_s / (2 * math.pi * _WHEEL_RADIUS_M)
    return [float(int(44 * turns))] * len(COLUMNS)


KIND = SensorKind(
    name="encoders",
    doc="Ticks of the four wheels.",
    config=Encoders,
    columns=COLUMNS,
    columns_name="ENCODER_COLUMNS",
    dtype="<i8",
    implementation="twin.sensors.encoders.wheels:WheelEncoders",
    made_up=_made_up,
)
