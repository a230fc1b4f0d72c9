"""The IMU: specific force and angular rate with scale error, wandering bias and white noise.

output = (1 + scale) x truth + bias + white noise, per axis. White noise of density N has
N sqrt(hz) per sample, so that its Allan deviation is N / sqrt(tau). The bias is a first-order
Gauss-Markov process of standard deviation B / 0.617, whose Allan deviation is highest, B, at 1.89
correlation times (IEEE Std 952-1997, annex C: exponentially correlated noise).
"""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from schemas.case import Case
from schemas.identity import case_stream
from schemas.kinds.sensors.imu import COLUMNS
from schemas.messages import SensorErrors
from twin.sensors.mount import KeyOf, SensorMount
from twin.sensors.noise import GAUSS_MARKOV_PEAK, Wander, gaussian, wander, wander_numbers
from twin.sensors.truth import FORCE
from twin.world.kernel_loading import load_kernels
from twin.world.mirror import Mirror, put_row, row_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_AXES = wp.constant(len(COLUMNS))
_ONE = wp.constant(wp.float64(1.0))


@wp.struct
class ImuErrors:
    """Errors of one slot's IMU; accelerometer first, then gyroscope."""

    key: wp.uint64
    active: wp.int32
    tick: wp.int32
    noise: wp.vec2d
    """White noise of a sample [m/s^2, rad/s]."""
    bias: wp.vec2d
    """Standard deviation of the bias [m/s^2, rad/s]."""
    scale: wp.vec2d
    """Standard deviation of the scale error [-]."""
    noise_factor: wp.float64
    """Set at run time [-]."""
    bias_factor: wp.float64
    wander: Wander


@wp.kernel
def imu_kernel(
    # args
    errors: wp.array(dtype=ImuErrors),
    truth: wp.array2d(dtype=wp.float64),
    # state in and out
    memory: wp.array2d(dtype=wp.float64),
    # out
    imu_out: wp.array2d(dtype=wp.float64),
):
    """One sample of all slots; ``memory`` [S, 12]: per axis the bias, then the scale error."""
    slot = wp.tid()
    own = errors[slot]
    for axis in range(_AXES):
        imu_out[slot, axis] = wp.float64(0.0)
    if own.active == 0:
        return
    for axis in range(_AXES):
        part = axis // 3
        if own.tick == 0:
            memory[slot, _AXES + axis] = gaussian(own.key, 0, 2 * _AXES + axis)
        memory[slot, axis] = wander(own.wander, memory[slot, axis], own.key, own.tick, _AXES + axis)
        value = truth[slot, FORCE + axis] * (_ONE + own.scale[part] * memory[slot, _AXES + axis])
        value += own.bias_factor * own.bias[part] * memory[slot, axis]
        value += own.noise_factor * own.noise[part] * gaussian(own.key, own.tick, axis)
        imu_out[slot, axis] = value


class InertialUnit:
    """IMUs of all slots, columns :data:`schemas.kinds.sensors.imu.COLUMNS`."""

    def __init__(self, mount: SensorMount) -> None:
        slots, device = mount.slots, mount.device
        self._hz, self.every = mount.hz, mount.every
        self._device = device
        self._errors = Mirror((slots,), ImuErrors, device)
        self._memory = wp.zeros((slots, 2 * len(COLUMNS)), dtype=wp.float64, device=device)
        self._values = Mirror((slots, len(COLUMNS)), wp.float64, device)
        load_kernels(device, [imu_kernel])

    def reset(self, slot: int, case: Case) -> None:
        """Begin a case."""
        imu = case.variation.sensors.imu
        root_hz = math.sqrt(self._hz)
        accel = (
            imu.accel_noise_mps2_per_sqrt_hz * root_hz,
            imu.accel_bias_mps2 / GAUSS_MARKOV_PEAK,
            imu.accel_scale,
        )
        gyro = (
            math.radians(imu.gyro_noise_degps_per_sqrt_hz) * root_hz,
            math.radians(imu.gyro_bias_degps) / GAUSS_MARKOV_PEAK,
            imu.gyro_scale,
        )
        row = self._errors.host[slot]
        for name, *pair in zip(("noise", "bias", "scale"), accel, gyro, strict=True):
            row[name] = pair if imu.noise else 0.0
        row["wander"] = wander_numbers(1.0 / self._hz, imu.bias_time_s)
        row["key"] = case_stream(case, "imu")
        row["noise_factor"] = row["bias_factor"] = 1.0
        row["active"] = 1

    def redraw(self, slot: int, key: KeyOf) -> None:
        """Draw by another key; the bias wanders on from where it is, and the scale stays."""
        self._errors.host[slot]["key"] = key("imu")

    def clear(self, slot: int) -> None:
        """Make a slot inactive."""
        self._errors.host[slot]["active"] = 0

    def hold(self, slot: int, *, held: bool) -> None:
        """Leave a slot out, or take it in again; its biases stay where they are."""
        self._errors.host[slot]["active"] = int(not held)

    def save(self, slot: int) -> dict[str, np.ndarray]:
        """Keys, factors and biases."""
        return {"errors": self._errors.host[slot].copy(), "memory": row_of(self._memory, slot)}

    def restore(self, slot: int, saved: dict[str, np.ndarray]) -> None:
        """Go on with them."""
        self._errors.host[slot] = saved["errors"]
        put_row(self._memory, slot, saved["memory"])

    def modulate(self, slot: int, errors: SensorErrors) -> None:
        """Errors from the next sample on."""
        self._errors.host[slot]["noise_factor"] = errors.imu_noise
        self._errors.host[slot]["bias_factor"] = errors.imu_bias

    def read(self, truth: wp.array, tick: np.ndarray) -> np.ndarray:
        """A sample float64 [S, 6]; zeros where inactive."""
        self._errors.host["tick"] = tick
        self._errors.push()
        wp.launch(
            imu_kernel,
            len(tick),
            inputs=[self._errors.device, truth, self._memory],
            outputs=[self._values.device],
            device=self._device,
        )
        return self._values.pull()
