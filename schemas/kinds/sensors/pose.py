"""The true pose."""

from __future__ import annotations

from schemas.kinds.sensor import MadeUpDrive, SensorConfig, SensorKind

COLUMNS = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
"""Columns of the true pose, float64 [S, 7]: the middle of the rear axle in the world, and the
rotation that takes vehicle axes to world axes."""


class PoseSensor(SensorConfig, frozen=True):
    """Where the car is and how it stands, without errors: for protocols that send it, and tests."""


def _made_up(drive: MadeUpDrive) -> list[float]:
    return [drive.speed_mps * drive.time_s, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


KIND = SensorKind(
    name="pose",
    doc="Where the car is and how it stands, without errors.",
    config=PoseSensor,
    columns=COLUMNS,
    columns_name="POSE_COLUMNS",
    dtype="<f8",
    implementation="twin.sensors.pose.true_pose:TruePose",
    made_up=_made_up,
)
