"""Incremental wheel encoders: ticks = floor(PPR x CGR x revolutions), whole numbers per wheel."""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from schemas.case import Case
from schemas.kinds.sensors.encoders import COLUMNS
from schemas.messages import SensorErrors
from twin.sensors.mount import SensorMount
from twin.sensors.truth import WHEELS
from twin.world.kernel_loading import load_kernels
from twin.world.mirror import Mirror

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_TWO_PI = wp.constant(wp.float64(2.0 * math.pi))


@wp.kernel
def encoders_kernel(
    # args
    ticks_per_rev: wp.array(dtype=wp.float64),
    truth: wp.array2d(dtype=wp.float64),
    # out
    ticks_out: wp.array2d(dtype=wp.int64),
):
    """Ticks of all wheels of a slot; ``ticks_per_rev`` 0: inactive."""
    slot = wp.tid()
    for wheel in range(4):
        ticks_out[slot, wheel] = wp.int64(0)
    if ticks_per_rev[slot] == wp.float64(0.0):
        return
    for wheel in range(4):
        revolutions = truth[slot, WHEELS + wheel] / _TWO_PI
        ticks_out[slot, wheel] = wp.int64(wp.floor(ticks_per_rev[slot] * revolutions))


class WheelEncoders:
    """Encoders of all slots, columns :data:`schemas.kinds.sensors.encoders.COLUMNS`."""

    def __init__(self, mount: SensorMount) -> None:
        self.every = mount.every
        """Control periods between two readings."""
        self._device = device = mount.device
        self._ticks_per_rev = Mirror((mount.slots,), wp.float64, device)
        self._ticks = Mirror((mount.slots, len(COLUMNS)), wp.int64, device)
        load_kernels(device, [encoders_kernel])

    def reset(self, slot: int, case: Case) -> None:
        """Begin a case."""
        self._ticks_per_rev.host[slot] = (
            case.variation.sensors.encoders.ppr * case.variation.sensors.encoders.cgr
        )

    def clear(self, slot: int) -> None:
        """Make a slot inactive."""
        self._ticks_per_rev.host[slot] = 0.0

    def hold(self, slot: int, *, held: bool) -> None:
        """A reading follows from the truth alone, and nobody reads that of a slot left out."""

    def save(self, _slot: int) -> dict[str, np.ndarray]:
        """A reading follows from the truth alone."""
        return {}

    def restore(self, slot: int, saved: dict[str, np.ndarray]) -> None:
        """There is nothing to go on with."""

    def modulate(self, slot: int, errors: SensorErrors) -> None:
        """An encoder has no errors but its steps."""

    def read(self, truth: wp.array, tick: np.ndarray) -> np.ndarray:
        """Ticks int64 [S, 4]; zeros where inactive."""
        self._ticks_per_rev.push()
        wp.launch(
            encoders_kernel,
            len(tick),
            inputs=[self._ticks_per_rev.device, truth],
            outputs=[self._ticks.device],
            device=self._device,
        )
        return self._ticks.pull()
