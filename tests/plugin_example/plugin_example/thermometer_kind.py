from typing import Annotated

from msgspec import Meta

from schemas.kinds.sensor import MadeUpDrive, SensorConfig, SensorKind


class ThermometerConfig(SensorConfig, frozen=True):
    """A thermometer in the shade."""

    lag_s: Annotated[float, Meta(gt=0, le=600)] = 5.0
    """Time constant of its first-order lag; it begins at 20 deg C [s]."""


def made_up(drive: MadeUpDrive) -> list[float]:
    return [15.0 + 0.1 * drive.time_s]


KIND = SensorKind(
    name="thermometer",
    doc="Temperature of the air.",
    config=ThermometerConfig,
    columns=("air_c",),
    columns_name="air_c",
    dtype="<f8",
    implementation="plugin_example.thermometer:Thermometer",
    made_up=made_up,
)
