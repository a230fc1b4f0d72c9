"""devkit.fusion.ego_motion: speed from counted ticks and an accelerometer."""

from __future__ import annotations

import math

import numpy as np
import pytest

from devkit.fusion.ego_motion import EgoMotion
from devkit.fusion.path import CarPath

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


def turning(yaw_rate_of, seconds: float, speed_mps: float):
    """The car's motion at every tick of a drive."""
    ego = EgoMotion(1)
    ego.reset(0, 0.0, 0.36)
    for k in range(round(seconds / PERIOD_S)):
        now_s = k * PERIOD_S
        vehicle = np.array([[speed_mps, 0.0, yaw_rate_of(now_s), 0.0, 0.0, 0.0, 0.0]])
        ego.update(vehicle, None, None, np.full(1, PERIOD_S))
        yield now_s, ego


def test_at_the_end_of_a_lane_change_what_stands_in_the_lane_left_is_not_on_the_path():
    """3.5 m in 3.5 s at 60 km/h, and a board in the middle of the lane left, from 5 s after the
    beginning on: the arc alone bends across it."""
    speed, wide_m, lasts_s, board_s = 16.667, 3.5, 3.5, 5.0
    peak = 2.0 * math.pi * wide_m / lasts_s**2 / speed

    def yaw_rate(t):
        return peak * math.sin(2.0 * math.pi * t / lasts_s) if t < lasts_s else 0.0

    def aside(t):
        t = min(t, lasts_s)
        phase = 2.0 * math.pi * t / lasts_s
        return wide_m * (t / lasts_s - math.sin(phase) / (2.0 * math.pi))

    by_arc = by_both = 0
    for now_s, ego in turning(yaw_rate, board_s - 0.5, speed):
        if now_s < 0.5 * lasts_s:
            continue
        heading = (aside(now_s + 0.01) - aside(now_s - 0.01)) / (0.02 * speed)
        ahead, beside = speed * (board_s - now_s), -aside(now_s)
        x = ahead * math.cos(heading) + beside * math.sin(heading)
        y = beside * math.cos(heading) - ahead * math.sin(heading)
        path = ego.path.of_slot(0)
        by_both += bool(path.holds(x, y - 0.5, y + 0.5, 1.1))
        by_arc += bool(CarPath(path.bend_per_m).holds(x, y - 0.5, y + 0.5, 1.1))
    assert by_arc > 5
    assert by_both == 0


@pytest.mark.parametrize("radius_m", [40.0, -250.0])
def test_in_a_curve_the_path_is_its_arc(radius_m):
    """Noise of a gyroscope included: nothing says that the car turns back."""
    speed = 10.0
    noise = np.random.default_rng(3).normal(0.0, 0.001, 200)
    for now_s, ego in turning(lambda t: speed / radius_m + noise[round(t / PERIOD_S)], 8.0, speed):
        x_m = min(30.0, 0.6 * abs(radius_m))
        y_m = radius_m - math.copysign(math.sqrt(radius_m**2 - x_m**2), radius_m)
        if now_s > 1.0:
            assert ego.path.of_slot(0).holds(x_m, y_m - 0.3, y_m + 0.3, 1.1)


def test_a_car_at_walking_pace_goes_where_its_gyroscope_says():
    """A robot, or a driver, may turn the wheel of a car whose feedback does not tell it."""
    *_, (_, ego) = turning(lambda t: -0.285, 2.0, 2.78)
    assert ego.curvature_per_m[0] == pytest.approx(-0.285 / 2.78, rel=1e-3)


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
