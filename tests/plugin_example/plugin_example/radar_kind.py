from typing import Annotated

from msgspec import Meta

from schemas.kinds.sensor import MadeUpDrive, SensorConfig, SensorKind


class RadarConfig(SensorConfig, frozen=True):
    """A radar that looks all around."""

    range_m: Annotated[float, Meta(gt=0, le=500)] = 60.0
    """Nothing farther away is seen [m]."""


def made_up(drive: MadeUpDrive) -> list[list[float]]:
    return [[max(1.0, 40.0 - drive.speed_mps * drive.time_s), 0.0]]


KIND = SensorKind(
    name="radar",
    doc="Range and bearing of what one can hit.",
    config=RadarConfig,
    columns=("range_m", "bearing_rad"),
    columns_name="RADAR_COLUMNS",
    dtype="<f4",
    rows_max=32,
    implementation="plugin_example.radar:Radar",
    made_up=made_up,
)
