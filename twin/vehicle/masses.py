"""Masses of a vehicle: four sprung corners, four wheels, and a load.

Sprung masses: M = sum M_i, X = sum M_i X_i / M, I = sum M_i X_i^2 (a tensor about X). A load is a
point mass in the body; what of it rests on each wheel follows from the levers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from msgspec import UNSET

from schemas.sections.scenario import Scenario
from twin.vehicle.vehicle_file import Vehicle


@dataclass(frozen=True, slots=True)
class Load:
    """What a vehicle carries beside its own mass."""

    mass_kg: float = 0.0
    x_m: float = 0.0
    """Ahead of the rear axle [m]."""
    y_m: float = 0.0
    """To the left of the middle [m]."""
    z_m: float = 0.0
    """Above the ground, where the vehicle stands [m]."""


NO_LOAD = Load()
LOAD_X_M, LOAD_Z_M = 1.0, 0.7
"""Where a load is that a scenario gives no place: about the middle of seats and boot [m]."""


def load_of(scenario: Scenario) -> Load:
    """The load that a scenario gives the ego."""
    if scenario.load_kg is UNSET or not scenario.load_kg:
        return NO_LOAD
    place = (scenario.load_x_m, scenario.load_y_m, scenario.load_z_m)
    usual = (LOAD_X_M, 0.0, LOAD_Z_M)
    x_m, y_m, z_m = (
        there if value is UNSET else value for value, there in zip(place, usual, strict=True)
    )
    return Load(scenario.load_kg, x_m, y_m, z_m)


@dataclass(frozen=True, slots=True)
class Masses:
    """Sprung masses and where they are; vehicle axes, origin in their centre."""

    corners: np.ndarray
    """Sprung mass that rests on each wheel, with the load [4] [kg]."""
    wheels: np.ndarray
    """Positions of the wheels [4, 2] [m]."""
    com_height_m: float
    """Height of the centre above the ground, at rest [m]."""
    inertia: np.ndarray
    """Tensor of the sprung masses about their centre [3, 3] [kg m^2]."""
    load_kg: float


def masses_of(vehicle: Vehicle, load: Load = NO_LOAD) -> Masses:
    """Masses of ``vehicle`` with a load.

    Raises:
        ValueError: the load is too heavy, or would lift a wheel; one line.
    """
    corners = np.array(vehicle.body.corner_mass_kg)
    from_rear = _wheels(vehicle)
    centre = corners @ from_rear / corners.sum()
    wheels = from_rear - centre
    points = np.zeros((4, 3))
    points[:, :2] = wheels * (vehicle.body.gyration_x, vehicle.body.gyration_y)
    inertia = _inertia(corners, points)
    height_m = vehicle.body.com_height_m
    if not load.mass_kg:
        return Masses(corners, wheels, height_m, inertia, 0.0)
    most_kg = vehicle.mass_max_kg
    if most_kg is not None and vehicle.mass_kg + load.mass_kg > most_kg:
        raise ValueError(
            f"a load of {load.mass_kg:g} kg makes {vehicle.mass_kg + load.mass_kg:g} kg, allowed: "
            f"mass_max_kg {most_kg:g}, a load of {most_kg - vehicle.mass_kg:g} kg"
        )
    loaded = corners + load.mass_kg * _shares(vehicle, load)
    if loaded.min() <= 0.0:
        raise ValueError(
            f"a load of {load.mass_kg:g} kg, {load.x_m:g} m ahead of the rear axle and "
            f"{load.y_m:g} m to the left, lifts a wheel; put it between the wheels"
        )
    total = corners.sum() + load.mass_kg
    moved = loaded @ from_rear / total
    loaded_height_m = float((corners.sum() * height_m + load.mass_kg * load.z_m) / total)
    # Both parts about the common centre (parallel axes).
    parts = np.array(
        [
            [*(centre - moved), height_m - loaded_height_m],
            [load.x_m - moved[0], load.y_m - moved[1], load.z_m - loaded_height_m],
        ]
    )
    inertia = inertia + _inertia(np.array([corners.sum(), load.mass_kg]), parts)
    return Masses(loaded, from_rear - moved, loaded_height_m, inertia, load.mass_kg)


def _wheels(vehicle: Vehicle) -> np.ndarray:
    """Wheels from the middle of the rear axle [4, 2] [m]."""
    half = vehicle.track_m / 2
    return np.array(
        [(vehicle.wheelbase_m, half), (vehicle.wheelbase_m, -half), (0, half), (0, -half)]
    )


def _shares(vehicle: Vehicle, load: Load) -> np.ndarray:
    """Share of a load that rests on each wheel [4]."""
    front = load.x_m / vehicle.wheelbase_m
    left = 0.5 + load.y_m / vehicle.track_m
    return np.array(
        [front * left, front * (1 - left), (1 - front) * left, (1 - front) * (1 - left)]
    )


def _inertia(mass: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Inertia tensor [3, 3] of point masses about their origin [kg m^2]."""
    square = (points**2).sum(axis=1)
    outer = np.einsum("i,ij,ik->jk", mass, points, points)
    tensor: np.ndarray = np.eye(3) * (mass * square).sum() - outer
    return tensor
