"""devkit.fusion.ego_motion: speed from counted ticks and an accelerometer."""

from __future__ import annotations

import math

import numpy as np
import pytest

from devkit.fusion.ego_motion import EgoMotion

PERIOD_S = 0.05
TICK_M = 2.0 * math.pi * 0.36 / 44.0


def drive(speed_of, seconds: float, *, bias_mps2: float = 0.0, imu: bool = True) -> list[float]:
    """Estimated speed at each tick of a drive."""
    ego = EgoMotion(1)
    ego.reset(0, 44.0, 0.36)
    estimates, way_m = [], 0.0
    for k in range(round(seconds / PERIOD_S)):
        v, before = speed_of(k * PERIOD_S), speed_of((k - 1) * PERIOD_S)
        way_m += 0.5 * (v + before) * PERIOD_S if k else 0.0
        inertial = np.zeros((1, 6))
        inertial[0, 0] = (v - before) / PERIOD_S + bias_mps2
        counts = np.full((1, 4), math.floor(way_m / TICK_M))
        ego.update(np.zeros((1, 7)), counts, inertial if imu else None, np.full(1, PERIOD_S))
        estimates.append(float(ego.speed_mps[0]))
    return estimates


@pytest.mark.parametrize("speed", [3.0, 8.0, 22.2])
def test_a_constant_speed_is_found_within_a_tenth(speed):
    estimates = drive(lambda t: speed, 4.0)
    assert max(abs(v - speed) for v in estimates[-40:]) < 0.1


def test_the_pitch_of_a_braking_car_costs_little():
    """2 degrees of pitch leak 0.34 m/s^2 of gravity into the accelerometer."""
    estimates = drive(lambda t: max(8.0 - 6.0 * max(t - 2.0, 0.0), 0.0), 3.0, bias_mps2=-0.34)
    truth = [max(8.0 - 6.0 * max(k * PERIOD_S - 2.0, 0.0), 0.0) for k in range(len(estimates))]
    assert max(abs(a - b) for a, b in zip(estimates[20:], truth[20:], strict=True)) < 0.45


def test_without_an_accelerometer_it_is_slower_but_comes():
    assert drive(lambda t: 8.0, 4.0, imu=False)[-1] == pytest.approx(8.0, abs=0.4)


def test_wheels_that_stand_are_standstill():
    ego = EgoMotion(1)
    ego.reset(0, 44.0, 0.36)
    for _ in range(10):
        ego.update(np.zeros((1, 7)), np.zeros((1, 4), int), np.zeros((1, 6)), np.full(1, PERIOD_S))
    assert ego.still[0]
    assert ego.speed_mps[0] == 0.0


def test_without_encoders_the_by_wire_feedback_counts():
    ego = EgoMotion(1)
    ego.reset(0, 0.0, 0.36)
    vehicle = np.array([[5.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0]])
    ego.update(vehicle, None, None, np.full(1, PERIOD_S))
    assert ego.speed_mps[0] == 5.0
    assert ego.yaw_rate_radps[0] == 0.1
    assert not ego.from_encoders[0]


def test_the_path_bends_as_yaw_rate_over_speed_says():
    ego = EgoMotion(1)
    ego.reset(0, 0.0, 0.36)
    vehicle = np.array([[10.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0]])
    for _ in range(100):
        ego.update(vehicle, None, None, np.full(1, PERIOD_S))
    assert ego.curvature_per_m[0] == pytest.approx(0.05, rel=1e-3)


def test_a_slow_car_goes_where_its_wheels_point():
    ego = EgoMotion(1)
    ego.reset(0, 0.0, 0.36)
    vehicle = np.array([[1.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0]])
    for _ in range(100):
        ego.update(vehicle, None, None, np.full(1, PERIOD_S))
    assert ego.curvature_per_m[0] == pytest.approx(math.tan(0.3) / 3.09, rel=0.01)


def test_the_nose_dives_with_what_the_accelerometer_feels_and_rises_again():
    ego = EgoMotion(2, 0.005)
    inertial = np.zeros((2, 6))
    for accel, dive, ticks in ((-8.0, 0.04, 12), (2.0, -0.01, 12)):
        inertial[0, 0] = accel
        for _ in range(ticks):
            ego.update(np.zeros((2, 7)), None, inertial, np.full(2, PERIOD_S))
        assert ego.dive_rad[0] == pytest.approx(dive, abs=1e-3)
        assert ego.dive_rad[1] == 0.0, "the neighbour's"
    before = ego.dive_rad.copy()
    ego.update(np.zeros((2, 7)), None, None, np.full(2, PERIOD_S))
    assert (ego.dive_rad == before).all(), "no reading, no news"
    ego.reset(0, 44.0, 0.36)
    assert ego.dive_rad[0] == 0.0
