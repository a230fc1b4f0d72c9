"""Vehicle substeps per second, beside the single-track model of commonroad-vehicle-models.

Rates are the best of several rounds: other load on the machine only ever slows a round down.
"""

from __future__ import annotations

import importlib.util
import time
from dataclasses import dataclass

import warp as wp

from twin.base.progress import steps
from twin.vehicle.fleet import Fleet
from twin.vehicle.vehicle_file import load_vehicle

TARGETS = {"cpu": 150_000.0, "cuda": 100e6}
"""Substeps per second on one core at 64 vehicles, on one H200 at 16,384."""
VEHICLES = {"cpu": 64, "cuda": 16_384}
ORACLE = "commonroad-vehicle-models"
_STEPS = 500
_ROUNDS = 5
_ROUND_S = 0.5


@dataclass(frozen=True, slots=True)
class VehicleFigures:
    """Figures of the vehicle bench."""

    device: str
    vehicles: int
    substeps_per_s: float
    oracle_steps_per_s: float | None
    """Single-track Runge-Kutta steps, None without the package."""

    @property
    def target(self) -> float:
        """Substeps per second to reach on this kind of device."""
        return TARGETS[self.device.partition(":")[0]]

    @property
    def ratio(self) -> float | None:
        """Substeps per step of the oracle."""
        oracle = self.oracle_steps_per_s
        return None if oracle is None else self.substeps_per_s / oracle


def measure(device: str, vehicles: int) -> VehicleFigures:
    """Drive ``vehicles`` cars, one per slot, and the oracle if it is installed."""
    oracle = _oracle_rate() if importlib.util.find_spec("vehiclemodels") else None
    return VehicleFigures(device, vehicles, _rate(device, vehicles), oracle)


def _rate(device: str, vehicles: int) -> float:
    warp_device = wp.get_device(device)
    fleet = Fleet([load_vehicle("opencav")], vehicles, warp_device)
    for slot in range(vehicles):
        fleet.place(slot, 0.0, 5.0 + slot % 20, 0.85, refresh=False)
        fleet.commands[slot, 0] = (0.3, 0.0, 0.01 * (slot % 5), 0.0, 1.0)
        fleet.active[slot] = 1
    fleet.refresh()
    fleet.push()
    fleet.launch(_STEPS)
    wp.synchronize_device(warp_device)
    best = 0.0
    for _ in steps("rounds", range(_ROUNDS)):
        launches, started = 0, time.perf_counter()
        while (spent := time.perf_counter() - started) < _ROUND_S:
            fleet.launch(_STEPS)
            wp.synchronize_device(warp_device)
            launches += 1
        best = max(best, launches * _STEPS * vehicles / spent)
    return best


def _oracle_rate() -> float:
    """Steps per second of its single-track model with classical Runge-Kutta."""
    import numpy as np
    from vehiclemodels.init_st import init_st
    from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
    from vehiclemodels.vehicle_dynamics_st import vehicle_dynamics_st

    parameters = parameters_vehicle2()
    x = np.array(init_st([0.0, 0.0, 0.02, 15.0, 0.0, 0.0, 0.0]))
    step_s, best = 0.002, 0.0

    def slope(state: np.ndarray) -> np.ndarray:
        return np.array(vehicle_dynamics_st(state, [0.0, 0.0], parameters))

    for _ in steps("rounds of the other model", range(_ROUNDS)):
        count, started = 0, time.perf_counter()
        while (spent := time.perf_counter() - started) < _ROUND_S / 2:
            a = slope(x)
            b = slope(x + step_s / 2 * a)
            c = slope(x + step_s / 2 * b)
            d = slope(x + step_s * c)
            x = x + step_s / 6 * (a + 2 * b + 2 * c + d)
            count += 1
        best = max(best, count / spent)
    return best
