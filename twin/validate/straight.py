"""Straight ahead: braking, accelerating, coasting."""

from __future__ import annotations

import math

import numpy as np
from msgspec.structs import replace

from twin.validate.check import CheckCurve, ManoeuvreCheck, thinned
from twin.validate.track import DriverInput, ManoeuvreRun, drive
from twin.vehicle.model import AIR_DENSITY_KGPM3, GRAVITY_MPS2
from twin.vehicle.state import COLUMN
from twin.vehicle.vehicle_file import MPH_60_MPS, Vehicle

DRY = 0.85
"""Friction of a dry road, as in the weather's presets [-]."""
_SPEED = COLUMN["speed_mps"]


def _speed_curve(run: ManoeuvreRun) -> tuple[CheckCurve, ...]:
    return (thinned(run.time_s, run.column("speed_mps"), "time [s]", "speed [m/s]"),)


def stop(vehicle: Vehicle, speed_mps: float, friction: float) -> ManoeuvreRun:
    """Full pedal from ``speed_mps`` until the vehicle stands."""

    def driver(_time_s: float, state: np.ndarray) -> DriverInput | None:
        return None if state[COLUMN["held"]] else DriverInput(brake=1.0)

    return drive(vehicle, driver, 60.0, speed_mps=speed_mps, friction=friction)


def braking_60mph(vehicle: Vehicle) -> list[ManoeuvreCheck]:
    """60 mph to rest on a dry road against the calibrated distance."""
    run = stop(vehicle, MPH_60_MPS, DRY)
    return [
        ManoeuvreCheck(
            f"braking from 60 mph, friction {DRY:g}",
            "m",
            float(run.end[COLUMN["x_m"]]),
            vehicle.brakes.distance_60mph_m,
            0.02,
            "brakes.distance_60mph_m",
            series=_speed_curve(run),
        )
    ]


def braking_fmvss135(vehicle: Vehicle) -> list[ManoeuvreCheck]:
    """100 km/h to rest within 70 m."""
    run = stop(vehicle, 100 / 3.6, DRY)
    distance = float(run.end[COLUMN["x_m"]])
    return [
        ManoeuvreCheck(
            "braking from 100 km/h", "m", distance, 70.0, 0.0, "FMVSS 135 S7.5", "at most"
        )
    ]


def braking_on(
    vehicle: Vehicle, frictions: tuple[float, ...] = (0.8, 0.5, 0.2)
) -> list[ManoeuvreCheck]:
    """Tyre-limited stops with ABS from 80 km/h, brakes applied at once: v^2 / (2 mu g).

    mu is the road's friction times the tyres' extremum.
    """
    if not vehicle.brakes.abs:
        return []
    ready = replace(vehicle, lags=replace(vehicle.lags, brake_s=0.0))
    # More brake than the tyres can use, whatever distance the file asks for.
    ready = replace(ready, brakes=replace(ready.brakes, distance_60mph_m=30.0))
    axles = (vehicle.front_tyres, vehicle.rear_tyres)
    extremum = sum(tyres.longitudinal.force_extremum for tyres in axles) / 2
    speed = 80 / 3.6
    found = []
    for friction in frictions:
        run = stop(ready, speed, friction)
        found.append(
            ManoeuvreCheck(
                f"ABS stop from 80 km/h, friction {friction:g}",
                "m",
                float(run.end[COLUMN["x_m"]]),
                speed**2 / (2 * friction * extremum * GRAVITY_MPS2),
                0.08,
                "v^2 / (2 mu g)",
                series=_speed_curve(run),
            )
        )
    return found


def zero_to_60mph(vehicle: Vehicle) -> list[ManoeuvreCheck]:
    """Full throttle from rest, against the file's cited figure."""
    reference = vehicle.reference.zero_to_60mph_s
    if reference is None:
        return []

    def driver(_time_s: float, state: np.ndarray) -> DriverInput | None:
        return None if state[_SPEED] >= MPH_60_MPS else DriverInput(throttle=1.0)

    run = drive(vehicle, driver, 60.0, friction=DRY, every=1)
    rpm = thinned(run.time_s, run.column("rpm"), "time [s]", "engine speed [rpm]")
    return [
        ManoeuvreCheck(
            "0 to 60 mph",
            "s",
            float(run.time_s[-1]),
            reference,
            0.05,
            "reference.zero_to_60mph_s",
            series=(*_speed_curve(run), rpm),
        )
    ]


def coast_down(
    vehicle: Vehicle, fast_mps: float = 30.0, slow_mps: float = 10.0
) -> list[ManoeuvreCheck]:
    """Out of gear from fast to slow: m v dv/dx = -(c v^2 + r) integrated."""
    wheels = vehicle.wheels
    drag = 0.5 * AIR_DENSITY_KGPM3 * vehicle.aero.idle_m2
    rolling = wheels.rolling_resistance * vehicle.mass_kg * GRAVITY_MPS2
    if drag == 0.0 or rolling == 0.0:
        return []
    inertia = vehicle.mass_kg + 4 * wheels.inertia_kgm2 / wheels.radius_m**2
    ratio = (drag * fast_mps**2 + rolling) / (drag * slow_mps**2 + rolling)

    def driver(_time_s: float, state: np.ndarray) -> DriverInput | None:
        return None if state[_SPEED] <= slow_mps else DriverInput(selector=0.0)

    run = drive(vehicle, driver, 300.0, speed_mps=fast_mps, friction=DRY)
    return [
        ManoeuvreCheck(
            f"coast-down from {fast_mps:g} to {slow_mps:g} m/s",
            "m",
            float(run.end[COLUMN["x_m"]]),
            inertia / (2 * drag) * math.log(ratio),
            0.02,
            "integral of drag and rolling resistance",
            series=_speed_curve(run),
        )
    ]
