"""Allan deviation of a simulated hour against the figures in the campaign file."""

import math

import numpy as np
import pytest
from sensor_rows import built, case, readings

from twin.sensors.imu.unit import InertialUnit

HZ = 10
CARS = 16
HOUR_TICKS = 3600 * HZ
TOLERANCE = 0.15


@pytest.fixture(scope="module")
def hour():
    """One hour of 16 standing cars with the default errors, [n, S, 6]."""
    sensor = built(InertialUnit, case(hz=HZ, imu={}), CARS)
    for slot in range(CARS):
        sensor.reset(slot, case(f"car-{slot}", hz=HZ, imu={}))
    return readings(sensor, CARS, HOUR_TICKS)


def allan_deviation(values, tau_s):
    """Overlapping Allan deviation of each column (IEEE Std 952-1997, annex C)."""
    m = round(tau_s * HZ)
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    second = total[2 * m :] - 2 * total[m:-m] + total[: -2 * m]
    return np.sqrt((second**2).mean(axis=0) / 2.0) / m


def figures(part):
    """N and B of the accelerometer or gyroscope, SI."""
    imu = case(imu={}).variation.sensors.imu
    if part == "accel":
        return imu.accel_noise_mps2_per_sqrt_hz, imu.accel_bias_mps2
    return math.radians(imu.gyro_noise_degps_per_sqrt_hz), math.radians(imu.gyro_bias_degps)


def of(hour, part):
    """Series of the three axes of all cars, less their mean."""
    values = hour[..., :3] if part == "accel" else hour[..., 3:]
    values = values.reshape(len(hour), -1)
    return values - values.mean(axis=0)


@pytest.mark.parametrize("part", ["accel", "gyro"])
def test_white_noise(hour, part):
    density, _ = figures(part)
    for tau_s in (0.1, 0.2, 0.5):
        found = allan_deviation(of(hour, part), tau_s)
        assert found == pytest.approx(density / math.sqrt(tau_s), rel=TOLERANCE)  # every axis


@pytest.mark.parametrize("part", ["accel", "gyro"])
def test_bias_instability(hour, part):
    _, instability = figures(part)
    tau_s = 1.8926 * case(imu={}).variation.sensors.imu.bias_time_s
    found = allan_deviation(of(hour, part), tau_s)
    assert math.sqrt((found**2).mean()) == pytest.approx(instability, rel=TOLERANCE)


@pytest.mark.parametrize("part", ["accel", "gyro"])
def test_whole_curve(hour, part):
    density, instability = figures(part)
    time_s = case(imu={}).variation.sensors.imu.bias_time_s
    for tau_s in (0.1, 1.0, 3.0, 10.0, 30.0, 100.0, 189.3, 300.0):
        x = tau_s / time_s
        markov = 2 / x * (1 - (3 - 4 * math.exp(-x) + math.exp(-2 * x)) / (2 * x))
        expected = math.sqrt(density**2 / tau_s + (instability / 0.617) ** 2 * markov)
        found = allan_deviation(of(hour, part), tau_s)
        assert math.sqrt((found**2).mean()) == pytest.approx(expected, rel=TOLERANCE), tau_s
