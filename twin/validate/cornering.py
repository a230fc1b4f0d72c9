"""Around corners: turning circle, steady cornering (ISO 4138), step steer."""

from __future__ import annotations

import math

import numpy as np

from twin.validate.check import ManoeuvreCheck, thinned
from twin.validate.track import DriverInput, ManoeuvreRun, drive
from twin.vehicle.masses import masses_of
from twin.vehicle.model import GRAVITY_MPS2
from twin.vehicle.state import COLUMN
from twin.vehicle.vehicle_file import TyreCurve, Vehicle

_SPEED, _YAW_RATE = COLUMN["speed_mps"], COLUMN["yaw_rate_radps"]
RADIUS_M = 100.0
"""Radius of steady cornering, ISO 4138 [m]."""
ACCELERATIONS_MPS2 = (1.0, 2.0, 3.0, 4.0)
STEP_SPEED_MPS, STEP_RAD = 80 / 3.6, math.radians(2.0)


def cruise(speed_mps: float, state: np.ndarray) -> float:
    """Throttle that keeps a speed, by the speed's error and the pedal map's droop."""
    return float(np.clip(0.3 + 0.8 * (speed_mps - state[_SPEED]), 0.0, 1.0))


def turning_radius(vehicle: Vehicle) -> list[ManoeuvreCheck]:
    """Walking pace: the rear axle's middle turns on L / tan delta (Ackermann)."""
    if vehicle.steering.ackermann < 1.0:
        return []
    found = []
    for share in (0.3, 1.0):
        steering = share * vehicle.steering.max_rad

        def driver(_time_s: float, state: np.ndarray, steering: float = steering) -> DriverInput:
            return DriverInput(throttle=cruise(1.2, state), steering_rad=steering)

        run = drive(vehicle, driver, 10.0, speed_mps=1.2)
        tail = run.states[len(run.states) // 2 :]
        radius = float((tail[:, _SPEED] / tail[:, _YAW_RATE]).mean())
        path = thinned(run.column("x_m"), run.column("y_m"), "x [m]", "y [m]")
        found.append(
            ManoeuvreCheck(
                f"turning radius at {steering:.2f} rad",
                "m",
                radius,
                vehicle.wheelbase_m / math.tan(steering),
                0.01,
                "L / tan(delta)",
                series=(path,),
            )
        )
    circle = vehicle.reference.turning_circle_m
    if circle is not None:
        outer = math.hypot(radius + vehicle.track_m / 2, vehicle.wheelbase_m)
        source = "reference.turning_circle_m"
        found.append(
            ManoeuvreCheck("turning circle, outer wheel", "m", 2 * outer, circle, 0.02, source)
        )
    return found


def _slip_at(curve: TyreCurve, force: float) -> float:
    """Slip at which a tyre gives ``force`` over its load, on the rising part of its curve."""
    s = np.linspace(0.0, 1.0, 20_001)
    k = curve.shape
    rising = curve.force_extremum * (((k - 2) * s + 3 - 2 * k) * s + k) * s
    return float(np.interp(force, rising, s * curve.slip_extremum))


def expected_steering(vehicle: Vehicle, accel_mps2: float, radius_m: float) -> float:
    """Steering angle of steady cornering by the single-track model with the axles' curves [rad].

    delta = L / R + alpha_f - alpha_r; an axle's slip follows from its share of the lateral force
    over its load, less what roll steers.
    """
    masses = masses_of(vehicle)
    wheels, mass = masses.wheels, masses.corners
    total, sprung = vehicle.mass_kg, float(mass.sum())
    front = -wheels[2, 0] / vehicle.wheelbase_m
    height, radius = vehicle.body.com_height_m, vehicle.wheels.radius_m
    stiffness = 0.0
    slips = []
    for first, axle, tyres, share in (
        (0, vehicle.front, vehicle.front_tyres, front),
        (2, vehicle.rear, vehicle.rear_tyres, 1.0 - front),
    ):
        load = (mass[first : first + 2].sum() + 2 * vehicle.wheels.mass_kg) * GRAVITY_MPS2
        slips.append(_slip_at(tyres.lateral, share * total * accel_mps2 / load))
        spring = mass[first : first + 2].mean() * axle.natural_frequency_radps**2
        stiffness += spring * vehicle.track_m**2 / 2 + axle.antiroll_nm_per_rad
    moment = accel_mps2 * (sprung * (height - radius) + total * radius)
    roll = moment / (stiffness - sprung * GRAVITY_MPS2 * (height - radius))
    slip = slips[0] - slips[1] - (vehicle.front.roll_steer - vehicle.rear.roll_steer) * roll
    return vehicle.wheelbase_m / radius_m + slip


def steady_corner(vehicle: Vehicle, accel_mps2: float) -> ManoeuvreRun:
    """Round a circle of :data:`RADIUS_M` at the speed for ``accel_mps2``, with a steady hand."""
    speed = math.sqrt(accel_mps2 * RADIUS_M)
    steering = vehicle.wheelbase_m / RADIUS_M

    def driver(_time_s: float, state: np.ndarray) -> DriverInput:
        nonlocal steering
        if state[_SPEED] > 1.0:
            error = 1.0 / RADIUS_M - state[_YAW_RATE] / state[_SPEED]
            steering += 0.02 * vehicle.wheelbase_m * error
        return DriverInput(throttle=cruise(speed, state), steering_rad=steering)

    return drive(vehicle, driver, 12.0, speed_mps=speed, every=10)


def understeer(vehicle: Vehicle) -> list[ManoeuvreCheck]:
    """ISO 4138: slope of the steering angle over lateral acceleration on a circle of 100 m."""
    measured, accels = [], []
    for accel in ACCELERATIONS_MPS2:
        end = steady_corner(vehicle, accel).states[-50:].mean(axis=0)
        measured.append(math.degrees(end[COLUMN["steering_rad"]]))
        accels.append(end[_SPEED] * end[_YAW_RATE])
    expected = [math.degrees(expected_steering(vehicle, a, RADIUS_M)) for a in accels]
    slope = float(np.polyfit(accels, measured, 1)[0])
    reference = float(np.polyfit(accels, expected, 1)[0])
    if abs(reference) < 0.02:
        # A neutral car: 15 % of almost nothing says nothing.
        return []
    accel_title = "lateral acceleration [m/s^2]"
    curve = thinned(np.array(accels), np.array(measured), accel_title, "steering [deg]")
    return [
        ManoeuvreCheck(
            "understeer gradient, ISO 4138",
            "deg s^2/m",
            slope,
            reference,
            0.15,
            "single-track model with the axles' curves",
            series=(curve,),
        )
    ]


def step_steer(vehicle: Vehicle) -> tuple[ManoeuvreRun, float, float]:
    """80 km/h, a step to 2 degrees, coasting: the run, yaw rate after 2 s [rad/s], rise time [s].

    The rise time is that to 90 % of the yaw rate after 2 s.
    """

    def driver(_time_s: float, _state: np.ndarray) -> DriverInput:
        return DriverInput(steering_rad=STEP_RAD, selector=0.0)

    run = drive(vehicle, driver, 2.0, speed_mps=STEP_SPEED_MPS, every=1)
    rate = run.column("yaw_rate_radps")
    return run, float(rate[-1]), float(run.time_s[int(np.argmax(rate >= 0.9 * rate[-1]))])


def step_response(vehicle: Vehicle) -> list[ManoeuvreCheck]:
    """The step steer against the file's figures of a multi-body model."""
    rate = vehicle.reference.step_steer_yaw_rate_degps
    rise = vehicle.reference.step_steer_rise_s
    if rate is None or rise is None:
        return []
    run, found, time_s = step_steer(vehicle)
    degrees = np.degrees(run.column("yaw_rate_radps"))
    curve = thinned(run.time_s, degrees, "time [s]", "yaw rate [deg/s]")
    where = "step to 2 deg at 80 km/h"
    return [
        ManoeuvreCheck(
            f"yaw rate, {where}",
            "deg/s",
            math.degrees(found),
            rate,
            0.05,
            "reference.step_steer_yaw_rate_degps",
            series=(curve,),
        ),
        ManoeuvreCheck(
            f"rise time, {where}", "s", time_s, rise, 0.15, "reference.step_steer_rise_s"
        ),
    ]
