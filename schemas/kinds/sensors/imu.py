"""An accelerometer and a gyroscope."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from schemas.kinds.sensor import (
    CorrelationTime,
    MadeUpDrive,
    Ros2Form,
    SensorConfig,
    SensorKind,
    Share,
)

COLUMNS = (
    "accel_x_mps2",
    "accel_y_mps2",
    "accel_z_mps2",
    "rate_x_radps",
    "rate_y_radps",
    "rate_z_radps",
)
"""Columns of the IMU, float64 [S, 6]: specific force (at rest +g up) and angular rate; x forward,
y left, z up."""


class Imu(SensorConfig, frozen=True):
    """Accelerometer and gyroscope, axes forward, left and up.

    They sit in the vehicle's centre of mass. Per axis: scale error, white noise of density N
    (Allan deviation N / sqrt(tau)) and a bias that wanders as a first-order Gauss-Markov process.
    Its own Allan deviation has its highest point at 1.89 ``bias_time_s``; the parameter ``*_bias``
    is the value there, so that it can be read off a data sheet's curve as "bias instability" (IEEE
    Std 952, annex C). Defaults are the figures of Xsens' MTi-1: 120 ug/sqrt(Hz), 0.03 mg,
    0.007 deg/s/sqrt(Hz), 10 deg/h (table in Transactions on Aerospace Research 2023,
    10.2478/tar-2023-0022); the correlation time and the scale errors are inferred.
    """

    noise: bool = True
    """Errors of any kind; false: the true values."""
    accel_noise_mps2_per_sqrt_hz: Annotated[float, Meta(ge=0, le=1)] = 1.18e-3
    """White noise density of the accelerometer; a sample has N sqrt(hz) [m/s^2/sqrt(Hz)]."""
    accel_bias_mps2: Annotated[float, Meta(ge=0, le=10)] = 2.9e-4
    """Bias instability of the accelerometer [m/s^2]."""
    accel_scale: Share = 0.005
    """Scale error of an accelerometer axis, drawn once per case [-]."""
    gyro_noise_degps_per_sqrt_hz: Annotated[float, Meta(ge=0, le=10)] = 0.007
    """White noise density of the gyroscope; a sample has N sqrt(hz) [deg/s/sqrt(Hz)]."""
    gyro_bias_degps: Annotated[float, Meta(ge=0, le=100)] = 0.0028
    """Bias instability of the gyroscope [deg/s]."""
    gyro_scale: Share = 0.005
    """Scale error of a gyroscope axis, drawn once per case [-]."""
    bias_time_s: CorrelationTime = 100.0
    """Correlation time of the biases [s]."""


def _made_up(drive: MadeUpDrive) -> list[float]:
    return [0.01 * drive.seed % 0.1, 0.0, 9.80665, 0.0, 0.0, 0.0]


KIND = SensorKind(
    name="imu",
    doc="Specific force and angular rate of the vehicle's centre of mass.",
    config=Imu,
    columns=COLUMNS,
    columns_name="IMU_COLUMNS",
    dtype="<f8",
    implementation="twin.sensors.imu.unit:InertialUnit",
    ros2=Ros2Form(
        "sensor_msgs/msg/Imu",
        {
            **{f"linear_acceleration.{axis}": f"accel_{axis}_mps2" for axis in "xyz"},
            **{f"angular_velocity.{axis}": f"rate_{axis}_radps" for axis in "xyz"},
        },
    ),
    made_up=_made_up,
)
