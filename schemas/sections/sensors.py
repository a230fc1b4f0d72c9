"""What a campaign file says about the car's own sensors: encoders, GNSS, IMU and the true pose.

A sensor is there if the section ``sensors`` names it: ``sensors: {gnss: {}, imu: {hz: 10}}``. Every
amplitude is one standard deviation (1 sigma) unless it says otherwise; 0 switches that error off,
``noise: false`` all errors of the sensor. Rates divide the control rate.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct, field

Share = Annotated[float, Meta(ge=0, le=0.5)]
Metres = Annotated[float, Meta(ge=0, le=1000)]
CorrelationTime = Annotated[float, Meta(ge=0.1, le=1_000_000)]
ControlRate = Annotated[int, Meta(ge=0, le=500)]
Point = Annotated[
    list[Annotated[float, Meta(ge=-20, le=20)]],
    Meta(min_length=3, max_length=3),
]
"""x forward of the vehicle's reference point, y left, z up [m]."""


class _Spec(Struct, frozen=True, forbid_unknown_fields=True):
    """Base of sensor types: frozen, unknown keys are errors."""


class Encoders(_Spec, frozen=True):
    """Incremental encoders on the four wheels: ticks = floor(ppr x cgr x revolutions)."""

    on: bool = True
    """Whether it is there."""
    hz: ControlRate = 0
    """Readings per second, a divisor of the control rate; 0: the control rate [Hz]."""
    ppr: Annotated[int, Meta(ge=1, le=1_000_000)] = 44
    """Pulses per revolution of the encoder's shaft (44: a common tone wheel of the wheel speed
    sensors of ABS, stated so in Hyundai's shop manual of the Tiburon 2007)."""
    cgr: Annotated[float, Meta(gt=0, le=1000)] = 1.0
    """Cumulative gear ratio: revolutions of the encoder's shaft per revolution of the wheel [-]."""


class Gnss(_Spec, frozen=True):
    """A satellite receiver: white noise, a bias that walks, and dropouts.

    The bias is a first-order Gauss-Markov process: a random walk that is pulled back, as measured
    on standing receivers (Sensors 2020, 20(21), 6050). Over times much shorter than
    ``bias_time_s`` it is a random walk of ``bias x sqrt(2 / bias_time_s)`` metres per root second.
    Defaults: code noise 0.25 m and multipath with 80 s correlation are figures in use for car
    navigation (NAVIGATION, ION: error budget of an INS with lidar and GNSS); the bias is chosen so
    that both together give the 1.5 m (CEP) that makers state for multi-band car receivers without
    corrections; vertical errors are 1.6 times as large (inferred).
    """

    on: bool = True
    """Whether it is there."""
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


class Imu(_Spec, frozen=True):
    """Accelerometer and gyroscope, axes forward, left and up.

    They sit in the vehicle's centre of mass. Per axis: scale error, white noise of density N
    (Allan deviation N / sqrt(tau)) and a bias that wanders as a first-order Gauss-Markov process.
    Its own Allan deviation has its highest point at 1.89 ``bias_time_s``; the parameter ``*_bias``
    is the value there, so that it can be read off a data sheet's curve as "bias instability" (IEEE
    Std 952, annex C). Defaults are the figures of Xsens' MTi-1: 120 ug/sqrt(Hz), 0.03 mg,
    0.007 deg/s/sqrt(Hz), 10 deg/h (table in Transactions on Aerospace Research 2023,
    10.2478/tar-2023-0022); the correlation time and the scale errors are inferred.
    """

    on: bool = True
    """Whether it is there."""
    hz: ControlRate = 0
    """Samples per second, a divisor of the control rate; 0: the control rate [Hz]."""
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


class PoseSensor(_Spec, frozen=True):
    """Where the car is and how it stands, without errors: for protocols that send it, and tests."""

    on: bool = True
    """Whether it is there."""
    hz: ControlRate = 0
    """Readings per second, a divisor of the control rate; 0: the control rate [Hz]."""


class Sensors(_Spec, frozen=True):
    """The section ``sensors``: a sensor that is not named is not there."""

    encoders: Encoders = Encoders(on=False)
    gnss: Gnss = Gnss(on=False)
    imu: Imu = Imu(on=False)
    pose: PoseSensor = PoseSensor(on=False)

    def rates(self, control_hz: int) -> dict[str, int]:
        """Name -> rate of every sensor that is on, in the order of the fields [Hz]."""
        sections = ((name, getattr(self, name)) for name in self.__struct_fields__)
        return {name: section.hz or control_hz for name, section in sections if section.on}
