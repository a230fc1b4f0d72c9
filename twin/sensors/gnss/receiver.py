"""The satellite receiver: WGS-84 position of its antenna with white noise, walking bias, dropouts.

position = truth + bias + white noise, in the world's axes; horizontal errors are alike in all
directions. Dropouts come at random times and last exponentially long; the receiver then sends no
fix (NaN, fix 0) while its bias walks on.
"""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from schemas.case import Case
from schemas.identity import case_stream
from schemas.kinds.sensors.gnss import COLUMNS
from schemas.messages import SensorErrors
from twin.base.portable.exact import not_a_number
from twin.sensors.gnss.geodesy import Datum, datum_of, geodetic
from twin.sensors.mount import KeyOf, SensorMount
from twin.sensors.noise import Wander, gaussian, uniform, wander, wander_numbers
from twin.sensors.truth import POSITION, rotation_at, vector_at
from twin.world.kernel_loading import load_kernels
from twin.world.mirror import Mirror, put_row, row_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_LOST = wp.constant(3)
"""Column of the memory: 1 during a dropout."""
_LOST_ELEMENT = wp.constant(6)


@wp.struct
class GnssErrors:
    """Errors of one slot's receiver."""

    key: wp.uint64
    active: wp.int32
    tick: wp.int32
    antenna: wp.vec3d
    """From the vehicle's reference point, vehicle axes [m]."""
    noise: wp.vec3d
    """White noise of a fix, world axes [m]."""
    bias: wp.vec3d
    """Standard deviation of the bias, world axes [m]."""
    lose: wp.float64
    """Probability that a dropout begins between two fixes [-]."""
    regain: wp.float64
    """Probability that it ends [-]."""
    noise_factor: wp.float64
    """Set at run time [-]."""
    bias_factor: wp.float64
    blocked: wp.int32
    """Set at run time: no fix at all."""
    wander: Wander


@wp.kernel
def gnss_kernel(
    # model
    datum: Datum,
    # args
    errors: wp.array(dtype=GnssErrors),
    truth: wp.array2d(dtype=wp.float64),
    # state in and out
    memory: wp.array2d(dtype=wp.float64),
    # out
    gnss_out: wp.array2d(dtype=wp.float64),
):
    """One fix of all slots; ``memory`` [S, 4]: bias in standard deviations, then 1 if lost."""
    slot = wp.tid()
    own = errors[slot]
    for column in range(4):
        gnss_out[slot, column] = _ZERO
    if own.active == 0:
        return
    if own.tick == 0:
        memory[slot, _LOST] = _ZERO
    luck = uniform(own.key, own.tick, _LOST_ELEMENT)
    if memory[slot, _LOST] > _ZERO:
        if luck < own.regain:
            memory[slot, _LOST] = _ZERO
    elif luck < own.lose:
        memory[slot, _LOST] = _ONE
    place = vector_at(truth, slot, POSITION) + wp.quat_rotate(rotation_at(truth, slot), own.antenna)
    for axis in range(3):
        memory[slot, axis] = wander(own.wander, memory[slot, axis], own.key, own.tick, 3 + axis)
        place[axis] += own.bias_factor * own.bias[axis] * memory[slot, axis]
        place[axis] += own.noise_factor * own.noise[axis] * gaussian(own.key, own.tick, axis)
    found = geodetic(datum, place)
    fix = own.blocked == 0 and memory[slot, _LOST] == _ZERO
    for column in range(3):
        gnss_out[slot, column] = wp.where(fix, found[column], not_a_number())
    gnss_out[slot, 3] = wp.where(fix, _ONE, _ZERO)


class SatelliteReceiver:
    """Receivers of all slots, columns :data:`schemas.kinds.sensors.gnss.COLUMNS`."""

    def __init__(self, mount: SensorMount) -> None:
        slots, device = mount.slots, mount.device
        self._hz, self.every = mount.hz, mount.every
        self._device = device
        self._datum = datum_of(mount.origin)
        self._errors = Mirror((slots,), GnssErrors, device)
        self._memory = wp.zeros((slots, 4), dtype=wp.float64, device=device)
        self._values = Mirror((slots, len(COLUMNS)), wp.float64, device)
        load_kernels(device, [gnss_kernel])

    def reset(self, slot: int, case: Case) -> None:
        """Begin a case."""
        gnss = case.variation.sensors.gnss
        period_s = 1.0 / self._hz
        row = self._errors.host[slot]
        row["antenna"] = gnss.antenna_m
        row["noise"] = row["bias"] = row["lose"] = 0.0
        row["regain"] = -math.expm1(-period_s / gnss.dropout_s)
        if gnss.noise:
            row["noise"] = [*[gnss.noise_horizontal_m] * 2, gnss.noise_vertical_m]
            row["bias"] = [*[gnss.bias_horizontal_m] * 2, gnss.bias_vertical_m]
            row["lose"] = -math.expm1(-period_s * gnss.dropouts_per_min / 60.0)
        row["wander"] = wander_numbers(period_s, gnss.bias_time_s)
        row["key"] = case_stream(case, "gnss")
        row["noise_factor"] = row["bias_factor"] = 1.0
        row["blocked"] = 0
        row["active"] = 1

    def redraw(self, slot: int, key: KeyOf) -> None:
        """Draw by another key; the bias wanders on from where it is."""
        self._errors.host[slot]["key"] = key("gnss")

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
        """Errors from the next fix on."""
        row = self._errors.host[slot]
        row["noise_factor"] = errors.gnss_noise
        row["bias_factor"] = errors.gnss_bias
        row["blocked"] = int(errors.gnss_dropout)

    def read(self, truth: wp.array, tick: np.ndarray) -> np.ndarray:
        """A fix float64 [S, 4]; zeros where inactive."""
        self._errors.host["tick"] = tick
        self._errors.push()
        wp.launch(
            gnss_kernel,
            len(tick),
            inputs=[self._datum, self._errors.device, truth, self._memory],
            outputs=[self._values.device],
            device=self._device,
        )
        return self._values.pull()
