"""Truth for the sensors from the vehicle state: a copy of columns, in the sensors' order."""

from __future__ import annotations

import warp as wp

from twin.sensors.truth import FORCE, POSITION, RATE, ROTATION, TRUTH, WHEELS
from twin.vehicle.state import VehicleState
from twin.world.kernel_loading import load_kernels

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def vehicle_truth_kernel(
    # state in
    state: wp.array2d(dtype=VehicleState),
    # out
    truth_out: wp.array2d(dtype=wp.float64),
):
    """The ego of every slot; the IMU sits in its centre of mass."""
    slot = wp.tid()
    own = state[slot, 0]
    truth_out[slot, POSITION] = own.x
    truth_out[slot, POSITION + 1] = own.y
    truth_out[slot, POSITION + 2] = own.z
    for axis in range(4):
        truth_out[slot, ROTATION + axis] = own.orientation[axis]
        truth_out[slot, WHEELS + axis] = own.wheel_angle[axis]
    for axis in range(3):
        truth_out[slot, FORCE + axis] = own.specific_force[axis]
        truth_out[slot, RATE + axis] = own.rate[axis]


class VehicleTruth:
    """Truth of all slots, updated whenever a sensor may be due."""

    def __init__(self, slots: int, device: wp.Device) -> None:
        self._device = device
        self._truth = wp.zeros((slots, len(TRUTH)), dtype=wp.float64, device=device)
        load_kernels(device, [vehicle_truth_kernel])

    def update(self, state: wp.array) -> wp.array:
        """Truth [S, T] on the device; ``state`` is VehicleState [S, V], the ego first."""
        wp.launch(
            vehicle_truth_kernel,
            self._truth.shape[0],
            inputs=[state],
            outputs=[self._truth],
            device=self._device,
        )
        return self._truth
