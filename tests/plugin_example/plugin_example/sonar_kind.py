from typing import Annotated

from msgspec import Meta

from schemas.kinds.sensor import MadeUpDrive, SensorConfig, SensorKind


class SonarConfig(SensorConfig, frozen=True):
    """A sonar that looks all around."""

    range_m: Annotated[float, Meta(gt=0, le=500)] = 60.0
    """Nothing farther away is seen [m]."""


def made_up(drive: MadeUpDrive) -> list[list[float]]:
    return [[max(1.0, 40.0 - drive.speed_mps * drive.time_s), 0.0]]


KIND = SensorKind(
    name="sonar",
    doc="Range and bearing of what one can hit.",
    config=SonarConfig,
    columns=("range_m", "bearing_rad"),
    columns_name="SONAR_COLUMNS",
    dtype="<f4",
    rows_max=32,
    implementation="plugin_example.sonar:Sonar",
    made_up=made_up,
)
