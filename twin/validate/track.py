"""A test track: one vehicle on level ground, a driver, and a record of its state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp

from twin.vehicle.fleet import Fleet
from twin.vehicle.model import PHYSICS_STEP_NS
from twin.vehicle.state import COLUMN, columns
from twin.vehicle.vehicle_file import Vehicle

STEP_S = PHYSICS_STEP_NS / 1e9
CONTROL_STEPS = 5
"""Physics steps between two looks of the driver."""


@dataclass(frozen=True, slots=True)
class DriverInput:
    """What a driver asks for."""

    throttle: float = 0.0
    brake: float = 0.0
    steering_rad: float = 0.0
    handbrake: float = 0.0
    selector: float = 1.0


Driver = Callable[[float, np.ndarray], DriverInput | None]
"""Time [s] and state [T] -> pedals; None: the manoeuvre is over."""


@dataclass(frozen=True, slots=True)
class ManoeuvreRun:
    """A manoeuvre as it was driven."""

    time_s: np.ndarray
    states: np.ndarray
    """[N, T], one row per look of the driver, the start included."""

    def column(self, name: str) -> np.ndarray:
        """A state variable over time [N]."""
        return self.states[:, COLUMN[name]]

    def field(self, name: str) -> np.ndarray:
        """A vector of the state over time, e.g. ``suspension`` [N, 4]."""
        return self.states[:, columns(name)]

    @property
    def end(self) -> np.ndarray:
        """The last state [T]."""
        return self.states[-1]


def drive(
    vehicle: Vehicle,
    driver: Driver,
    duration_s: float,
    *,
    speed_mps: float = 0.0,
    friction: float = 1.0,
    start: Callable[[np.ndarray], None] | None = None,
    device: str = "cpu",
    every: int = CONTROL_STEPS,
) -> ManoeuvreRun:
    """Drive until the driver has had enough or time is up.

    Args:
        start: changes the initial state [T] in place.
        every: physics steps between two looks of the driver, at least 1.
    """
    fleet = Fleet([vehicle], 1, wp.get_device(device))
    fleet.place(0, 0.0, speed_mps, friction)
    fleet.active[0] = 1
    if start is not None:
        start(fleet.state[0, 0])
        fleet.refresh()
    states = [fleet.state[0, 0].copy()]
    for look in range(round(duration_s / (STEP_S * every))):
        pedals = driver(look * every * STEP_S, states[-1])
        if pedals is None:
            break
        fleet.commands[0, 0] = (
            pedals.throttle,
            pedals.brake,
            pedals.steering_rad,
            pedals.handbrake,
            pedals.selector,
        )
        fleet.first_step[0] = look * every
        fleet.advance(every)
        states.append(fleet.state[0, 0].copy())
    fault = fleet.fault(0)
    if fault:
        raise ValueError(f"{vehicle.vehicle}: {fault}, after {len(states) * every * STEP_S:g} s")
    return ManoeuvreRun(np.arange(len(states)) * every * STEP_S, np.array(states))
