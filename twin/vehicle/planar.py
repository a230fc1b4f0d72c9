"""Planar vehicles of all slots: constant Model, changing State, one launch per control period."""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from twin.vehicle import dynamics
from twin.vehicle.vehicle_file import Vehicle
from twin.world.mirror import Mirror

PHYSICS_STEP_NS = 2_000_000
"""Physics step [ns]."""

COLUMN: dict[str, int] = {name: i for i, name in enumerate(dynamics.TELEMETRY)}
"""Column of a state variable in the state array."""


def vehicle_model(vehicle: Vehicle) -> dynamics.VehicleModel:
    """Constants of ``vehicle`` for kernels."""
    step_s = PHYSICS_STEP_NS / 1e9

    def gain(lag_s: float) -> float:
        return 1.0 if lag_s == 0.0 else -math.expm1(-step_s / lag_s)

    model = dynamics.VehicleModel()
    model.wheelbase = vehicle.wheelbase_m
    model.half_length, model.half_width = vehicle.length_m / 2, vehicle.width_m / 2
    model.centre_offset = vehicle.centre_offset_m
    model.mass, model.drag_area = vehicle.mass_kg, vehicle.drag_area_m2
    model.rolling = vehicle.rolling_resistance
    model.drive_force, model.drive_power = vehicle.drive_force_max_n, vehicle.drive_power_max_w
    model.pedal_slope = vehicle.pedal_slope_ns_per_m
    model.brake_force, model.steering_max = vehicle.brake_force_max_n, vehicle.steering_max_rad
    model.throttle_gain = gain(vehicle.throttle_lag_s)
    model.brake_gain = gain(vehicle.brake_lag_s)
    model.steering_gain = gain(vehicle.steering_lag_s)
    model.step = step_s
    return model


class PlanarVehicles:
    """One vehicle per slot.

    Host arrays, written before :meth:`advance`: ``friction`` [S], ``commands`` [S, 2, 3],
    ``switch_step`` [S], ``first_step`` [S], ``active`` [S]; see
    :func:`twin.vehicle.dynamics.drive_kernel`. ``state`` [S, T] is valid after each call.
    """

    def __init__(
        self, vehicle: Vehicle, colliders: np.ndarray, slots: int, device: wp.Device
    ) -> None:
        self._model = vehicle_model(vehicle)
        self._colliders = wp.array(colliders, dtype=wp.float64, device=device)
        self._device = device
        self._slots = slots
        self._state = Mirror((slots, len(dynamics.TELEMETRY)), wp.float64, device)
        self._friction = Mirror((slots,), wp.float64, device)
        self._commands = Mirror((slots, 2, 3), wp.float64, device)
        self._switch_step = Mirror((slots,), wp.int32, device)
        self._first_step = Mirror((slots,), wp.int32, device)
        self._active = Mirror((slots,), wp.int32, device)
        self.state = self._state.host
        self.friction = self._friction.host
        self.commands = self._commands.host
        self.switch_step = self._switch_step.host
        self.first_step = self._first_step.host
        self.active = self._active.host
        wp.load_module(dynamics, device=device)

    @property
    def state_device(self) -> wp.array:
        """State on the device, float64 [S, T]; x, y and yaw come first."""
        return self._state.device

    def place(self, slot: int, x_m: float, speed_mps: float, friction: float) -> None:
        """Put a slot's vehicle on the lane's centre, heading along the street."""
        self.state[slot] = 0.0
        row = self.state[slot]
        row[COLUMN["x_m"]], row[COLUMN["speed_mps"]] = x_m, speed_mps
        row[COLUMN["impact_step"]] = row[COLUMN["rest_step"]] = -1.0
        row[COLUMN["moved"]], row[COLUMN["finite"]] = float(speed_mps > 0.0), 1.0
        self.friction[slot] = friction
        self.commands[slot] = 0.0
        self._state.push()
        wp.launch(
            dynamics.measure_kernel,
            self._slots,
            inputs=[self._model, self._colliders],
            outputs=[self._state.device],
            device=self._device,
        )
        self._state.pull()

    def advance(self, steps: int) -> None:
        """Advance all active slots by ``steps`` physics steps."""
        inputs = (
            self._friction,
            self._commands,
            self._switch_step,
            self._first_step,
            self._active,
        )
        for mirror in inputs:
            mirror.push()
        wp.launch(
            dynamics.drive_kernel,
            self._slots,
            inputs=[self._model, self._colliders, steps, *(m.device for m in inputs)],
            outputs=[self._state.device],
            device=self._device,
        )
        self._state.pull()
