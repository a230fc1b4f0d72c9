"""Powers in all cells of a radar's measurement: range, radial speed, azimuth."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from schemas.kinds.sensor import GridLook, MadeUpDrive, SensorConfig, SensorKind

RANGES, SPEEDS, AZIMUTHS = 400, 160, 32
"""Cells of a cube along its axes: as many ranges and speeds as any shipped profile has."""

AXES = ("range", "radial_speed", "azimuth")
"""Axes of a radar's cube, float32 [S, 400, 160, 32]: the power of a beam over that of its thermal
noise. Range cell i is at i times the profile's range cell, speed cell j at the profile's lowest
speed and j times its speed cell. Beam k looks where y / R is ((k + 0.5) / 32 - 0.5) over the
spacing of the columns in wavelengths: with 0.5, from -0.97 to 0.97, left positive. Cells that a
profile lacks hold 0."""


class RadarCube(SensorConfig, frozen=True):
    """The range-Doppler-angle cube of the section ``radar``, whose keys say how it is made."""

    hz: Annotated[int, Meta(ge=0, le=500)] = 5
    """Cubes per second, a divisor of the radar's rate; 0: the control rate [Hz]."""


def _made_up(drive: MadeUpDrive) -> list[list[float]]:
    far_m = max(1.0, 60.0 - drive.speed_mps * drive.time_s)
    return [[int(far_m / 0.6), 100, AZIMUTHS // 2, 1000.0]]


KIND = SensorKind(
    name="radar_cube",
    doc="Power in every cell of range, radial speed and azimuth of the radar's measurement.",
    config=RadarCube,
    columns=AXES,
    columns_name="RADAR_CUBE_AXES",
    dtype="<f4",
    grid=(RANGES, SPEEDS, AZIMUTHS),
    part_of="radar",
    implementation="twin.sensors.radar_cube.unit:RadarCubeUnit",
    picture=GridLook(low_db=0.0, high_db=50.0),
    made_up=_made_up,
)
