"""Truth for the sensors from the planar vehicle: flat road, no roll, wheels that do not slip."""

from __future__ import annotations

import numpy as np
import warp as wp

from twin.sensors.truth import FORCE, POSITION, RATE, ROTATION, TRUTH, WHEELS
from twin.vehicle.dynamics import GRAVITY_MPS2
from twin.vehicle.planar import COLUMN
from twin.vehicle.vehicle_file import Vehicle
from twin.world.mirror import Mirror

wp.set_module_options({"enable_backward": False})

WHEEL_RADIUS_M = 0.35
"""Rolling radius; the planar vehicle's file does not say (235/60 R18 rolls at about 0.35 m) [m]."""

_RADIUS = wp.constant(wp.float64(WHEEL_RADIUS_M))
_X, _Y, _YAW, _SPEED, _ACCEL, _YAW_RATE = (
    wp.constant(COLUMN[name])
    for name in ("x_m", "y_m", "yaw_rad", "speed_mps", "accel_mps2", "yaw_rate_radps")
)
_HALF = wp.constant(wp.float64(0.5))


@wp.kernel
def planar_truth_kernel(
    # model
    wheelbase: wp.float64,
    track: wp.float64,
    # state in
    state: wp.array2d(dtype=wp.float64),
    tick: wp.array(dtype=wp.int32),
    active: wp.array(dtype=wp.int32),
    # state in and out
    pose: wp.array2d(dtype=wp.float64),
    # out
    truth_out: wp.array2d(dtype=wp.float64),
):
    """One call per control period and slot: ``pose`` [S, 3] is x, y, yaw of the last call.

    Since then the rear axle's middle went an arc of chord c and angle a: its length is
    c (a / 2) / sin(a / 2). A wheel b to the left and l in front of it goes
    sqrt((length - a b)^2 + (a l)^2), forward as the vehicle does.
    """
    slot = wp.tid()
    if active[slot] == 0:
        return
    x = state[slot, _X]
    y = state[slot, _Y]
    yaw = state[slot, _YAW]
    if tick[slot] == 0:
        for wheel in range(4):
            truth_out[slot, WHEELS + wheel] = wp.float64(0.0)
    else:
        dx = x - pose[slot, 0]
        dy = y - pose[slot, 1]
        angle = yaw - pose[slot, 2]
        length = wp.sqrt(dx * dx + dy * dy)
        if wp.abs(angle) > wp.float64(1.0e-9):
            length *= _HALF * angle / wp.sin(_HALF * angle)
        for wheel in range(4):
            left = wp.where(wheel % 2 == 0, _HALF * track, -_HALF * track)
            forward = wp.where(wheel < 2, wheelbase, wp.float64(0.0))
            way = length - angle * left
            side = angle * forward
            turned = wp.sign(way) * wp.sqrt(way * way + side * side) / _RADIUS
            truth_out[slot, WHEELS + wheel] = truth_out[slot, WHEELS + wheel] + turned
    pose[slot, 0] = x
    pose[slot, 1] = y
    pose[slot, 2] = yaw
    truth_out[slot, POSITION] = x
    truth_out[slot, POSITION + 1] = y
    truth_out[slot, POSITION + 2] = wp.float64(0.0)
    truth_out[slot, ROTATION] = wp.float64(0.0)
    truth_out[slot, ROTATION + 1] = wp.float64(0.0)
    truth_out[slot, ROTATION + 2] = wp.sin(_HALF * yaw)
    truth_out[slot, ROTATION + 3] = wp.cos(_HALF * yaw)
    truth_out[slot, FORCE] = state[slot, _ACCEL]
    truth_out[slot, FORCE + 1] = state[slot, _SPEED] * state[slot, _YAW_RATE]
    truth_out[slot, FORCE + 2] = GRAVITY_MPS2
    truth_out[slot, RATE] = wp.float64(0.0)
    truth_out[slot, RATE + 1] = wp.float64(0.0)
    truth_out[slot, RATE + 2] = state[slot, _YAW_RATE]


class PlanarTruth:
    """Truth of all slots from the planar state, updated once per control period."""

    def __init__(self, vehicle: Vehicle, slots: int, device: wp.Device) -> None:
        self._vehicle = vehicle
        self._device = device
        self._tick = Mirror((slots,), wp.int32, device)
        self._active = Mirror((slots,), wp.int32, device)
        self._pose = wp.zeros((slots, 3), dtype=wp.float64, device=device)
        self._truth = wp.zeros((slots, len(TRUTH)), dtype=wp.float64, device=device)
        wp.load_module(planar_truth_kernel.module.name, device=device)

    def update(self, state: wp.array, tick: np.ndarray, active: np.ndarray) -> wp.array:
        """Truth [S, T] on the device at the current ticks; ``state`` is that of the vehicles."""
        self._tick.host[:] = tick
        self._active.host[:] = active
        self._tick.push()
        self._active.push()
        wp.launch(
            planar_truth_kernel,
            len(tick),
            inputs=[
                *(self._vehicle.wheelbase_m, self._vehicle.track_m),
                *(state, self._tick.device, self._active.device, self._pose),
            ],
            outputs=[self._truth],
            device=self._device,
        )
        return self._truth
