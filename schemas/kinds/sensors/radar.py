"""A frequency-modulated radar at 77 GHz."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from schemas.kinds.sensor import MadeUpDrive, Point, PointsLook, Ros2Form, SensorConfig, SensorKind

COLUMNS = (
    "range_m",
    "azimuth_rad",
    "elevation_rad",
    "radial_speed_mps",
    "rcs_dbsm",
    "snr_db",
)
"""Columns of a radar's detections, float32 [S, N, 6], in the axes of its mount (x forward, y left,
z up): azimuth is positive to the left, elevation upwards. The radial speed is that of what was
detected relative to the radar, positive when it moves away. The radar cross section follows from
the signal by the radar equation in clear air. Rows are sorted by range cell, then by azimuth."""

DETECTIONS_MAX = 128
"""Most detections of one measurement; of more the strongest are kept."""

PROFILES = ("long_range", "mid_range", "corner")
"""Radars that are shipped."""


class Radar(SensorConfig, frozen=True):
    """A chirp-sequence radar with a virtual array: detections of a constant false-alarm rate.

    What a radar is built like stands in its profile (``twin/sensors/radar/profiles``).
    """

    hz: Annotated[int, Meta(ge=0, le=500)] = 20
    """Measurements per second, a divisor of the control rate; 0: the control rate [Hz]."""
    profile: Literal["long_range", "mid_range", "corner"] = "long_range"
    """Which radar it is."""
    position_m: Point | None = None
    """Where it sits: x forward of the vehicle's reference point, y left, z up [m]; none: where the
    profile says, at the vehicle's front."""
    yaw_deg: Annotated[float, Meta(ge=-180, le=180)] | None = None
    """Where it looks, to the left of forward [deg]; none: where the profile says."""
    noise: bool = True
    """Thermal noise, and echoes of rain and snow; false: neither."""
    weather: bool = True
    """Rain and snow weaken the signal; false: always clear."""
    multipath: bool = True
    """Reflections by the road and by walls; false: direct paths alone."""
    clutter: bool = True
    """Echoes of the road and of all that stands beside it; false: vehicles and people alone."""


def _made_up(drive: MadeUpDrive) -> list[list[float]]:
    far_m = max(1.0, 60.0 - drive.speed_mps * drive.time_s)
    return [[far_m, 0.01, 0.0, -drive.speed_mps, 10.0, 30.0]]


KIND = SensorKind(
    name="radar",
    doc="Range, direction and radial speed of what reflects millimetre waves.",
    config=Radar,
    columns=COLUMNS,
    columns_name="RADAR_COLUMNS",
    dtype="<f4",
    rows_max=DETECTIONS_MAX,
    implementation="twin.sensors.radar.unit:RadarUnit",
    no_axes=("position_m",),
    points=PointsLook(
        range_m="range_m",
        azimuth_rad="azimuth_rad",
        elevation_rad="elevation_rad",
        color="radial_speed_mps",
        span=(-15.0, 15.0),
    ),
    memory="twin.sensors.radar.unit:bytes_of",
    site="twin.sensors.radar.unit:site_of",
    ros2=Ros2Form(
        "radar_msgs/msg/RadarScan",
        {
            "range": "range_m",
            "azimuth": "azimuth_rad",
            "elevation": "elevation_rad",
            "doppler_velocity": "radial_speed_mps",
            "amplitude": "snr_db",
        },
    ),
    made_up=_made_up,
)
