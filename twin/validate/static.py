"""At rest and up and down: sag, and the body's free heave on its springs."""

from __future__ import annotations

import math

import numpy as np
from msgspec.structs import replace

from twin.validate.check import ManoeuvreCheck, thinned
from twin.validate.track import DriverInput, drive
from twin.vehicle.model import GRAVITY_MPS2
from twin.vehicle.state import COLUMN, columns
from twin.vehicle.vehicle_file import Vehicle

_STIFF_N_PER_M = 3.0e6
"""A tyre so stiff that the body moves on its springs alone."""
_WHEEL = ("front left", "front right", "rear left", "rear right")


def static_sag(vehicle: Vehicle) -> list[ManoeuvreCheck]:
    """Let the vehicle settle from 5 mm above its place; corner sag is M_i g / K_i = g / w_n^2."""

    def lift(state: np.ndarray) -> None:
        state[COLUMN["com_z_m"]] += 0.005

    run = drive(vehicle, lambda _t, _s: DriverInput(brake=1.0), 6.0, start=lift, every=25)
    found = []
    for wheel, name in enumerate(_WHEEL):
        axle = vehicle.front if wheel < 2 else vehicle.rear
        sag = run.field("suspension")[:, wheel]
        found.append(
            ManoeuvreCheck(
                f"static sag, {name}",
                "mm",
                1e3 * float(sag[-1]),
                1e3 * GRAVITY_MPS2 / axle.natural_frequency_radps**2,
                0.01,
                "M_i g / K_i",
                series=(thinned(run.time_s, 1e3 * sag, "time [s]", f"sag {name} [mm]"),),
            )
        )
    return found


def heave_frequency(time_s: np.ndarray, z_m: np.ndarray) -> tuple[float, float]:
    """Natural frequency [rad/s] and damping ratio of a free decay about 0.

    By linear least squares of z'' + 2 zeta w z' + w^2 z = 0 over the decay, with central
    differences.
    """
    dt = time_s[1] - time_s[0]
    first = (z_m[2:] - z_m[:-2]) / (2 * dt)
    second = (z_m[2:] - 2 * z_m[1:-1] + z_m[:-2]) / dt**2
    (damping, square), *_ = np.linalg.lstsq(
        np.stack([first, z_m[1:-1]], axis=1), -second, rcond=None
    )
    frequency = math.sqrt(square)
    return frequency, damping / (2 * frequency)


def free_heave(vehicle: Vehicle) -> list[ManoeuvreCheck]:
    """Drop the body by 20 mm onto one axle's springs, all four alike, on stiff tyres."""
    found = []
    for axle in ("front", "rear"):
        spring = getattr(vehicle, axle)
        quarter = sum(vehicle.body.corner_mass_kg) / 4
        wheels = replace(vehicle.wheels, stiffness_n_per_m=_STIFF_N_PER_M, damping_ns_per_m=4e3)
        alike = replace(
            vehicle,
            front=spring,
            rear=spring,
            body=replace(vehicle.body, corner_mass_kg=[quarter] * 4),
            wheels=wheels,
        )

        def drop(state: np.ndarray) -> None:
            state[COLUMN["com_z_m"]] -= 0.02
            state[columns("suspension")] += 0.02

        run = drive(alike, lambda _t, _s: DriverInput(brake=1.0), 2.0, start=drop, every=1)
        z = run.field("suspension").mean(axis=1)
        z = z - GRAVITY_MPS2 / spring.natural_frequency_radps**2
        # The wheels have come to rest on their tyres by then.
        late = run.time_s > 0.1
        frequency, ratio = heave_frequency(run.time_s[late], z[late])
        curve = thinned(run.time_s, 1e3 * z, "time [s]", f"heave on {axle} springs [mm]")
        found += [
            ManoeuvreCheck(
                f"heave frequency, {axle} springs",
                "rad/s",
                frequency,
                spring.natural_frequency_radps,
                0.02,
                "w_n of the file",
                series=(curve,),
            ),
            ManoeuvreCheck(
                f"heave damping, {axle} springs",
                "-",
                ratio,
                spring.damping_ratio,
                0.02,
                "zeta of the file",
            ),
        ]
    return found
