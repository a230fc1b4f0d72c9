"""A satellite receiver."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, field

from schemas.kinds.sensor import (
    CorrelationTime,
    MadeUpDrive,
    Point,
    Ros2Form,
    SensorConfig,
    SensorKind,
)

COLUMNS = ("latitude_deg", "longitude_deg", "altitude_m", "fix")
"""Columns of the satellite receiver, float64 [S, 4]: WGS-84, altitude above the ellipsoid; fix is
1, or 0 in a dropout, when the others are NaN."""
Metres = Annotated[float, Meta(ge=0, le=1000)]


class Gnss(SensorConfig, frozen=True):
    """A satellite receiver: white noise, a bias that walks, and dropouts.

    The bias is a first-order Gauss-Markov process: a random walk that is pulled back, as measured
    on standing receivers (Sensors 2020, 20(21), 6050). Over times much shorter than
    ``bias_time_s`` it is a random walk of ``bias x sqrt(2 / bias_time_s)`` metres per root second.
    Defaults: code noise 0.25 m and multipath with 80 s correlation are figures in use for car
    navigation (NAVIGATION, ION: error budget of an INS with lidar and GNSS); the bias is chosen so
    that both together give the 1.5 m (CEP) that makers state for multi-band car receivers without
    corrections; vertical errors are 1.6 times as large (inferred).
    """

    hz: Annotated[int, Meta(ge=0, le=500)] = 10
    """Fixes per second, a divisor of the control rate; 0: the control rate [Hz]."""
    antenna_m: Point = field(default_factory=lambda: [1.4, 0.0, 1.5])
    """Where the antenna sits: x forward of the vehicle's reference point, y left, z up [m]."""
    noise: bool = True
    """Errors of any kind; false: the true position, always."""
    noise_horizontal_m: Metres = 0.25
    """White noise of a fix, east and north each [m]."""
    noise_vertical_m: Metres = 0.4
    """White noise of a fix, up [m]."""
    bias_horizontal_m: Metres = 1.25
    """What the walking bias settles at, east and north each [m]."""
    bias_vertical_m: Metres = 2.0
    """What the walking bias settles at, up [m]."""
    bias_time_s: CorrelationTime = 80.0
    """Correlation time of the bias [s]."""
    dropouts_per_min: Annotated[float, Meta(ge=0, le=600)] = 0.0
    """Mean number of dropouts per minute of reception; they come at random times [1/min]."""
    dropout_s: Annotated[float, Meta(gt=0, le=3600)] = 2.0
    """Mean length of a dropout [s]."""


def _made_up(drive: MadeUpDrive) -> list[float]:
    return [34.0 + 1e-6 * drive.tick, -82.0, 210.0, 1.0]


KIND = SensorKind(
    name="gnss",
    doc="Latitude, longitude and altitude of an antenna.",
    config=Gnss,
    columns=COLUMNS,
    columns_name="GNSS_COLUMNS",
    dtype="<f8",
    implementation="twin.sensors.gnss.receiver:SatelliteReceiver",
    no_axes=("antenna_m",),
    ros2=Ros2Form(
        "sensor_msgs/msg/NavSatFix",
        {
            "latitude": "latitude_deg",
            "longitude": "longitude_deg",
            "altitude": "altitude_m",
            "status": "fix",
        },
    ),
    made_up=_made_up,
)
