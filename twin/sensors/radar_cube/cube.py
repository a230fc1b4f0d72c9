"""The range-Doppler-angle cube of a radar: beams over the lower row in every cell of its map.

A beam is the sum of the lower row's M signals, each turned back by its share of a phase that grows
from column to column; its power over M is that over the beam's thermal noise. The mean over the
beams, which divide a turn evenly, is the mean power of the M antennas (Parseval), whatever they
hold. The noise of a cell is the one that its detections have.
"""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from schemas.kinds.sensors.radar_cube import AZIMUTHS, RANGES, SPEEDS
from schemas.steady import steady
from twin.sensors.radar import detect
from twin.sensors.radar.detect import antennas_of
from twin.sensors.radar.echo import RadarModel, RadarSlot, complex_product
from twin.sensors.radar.sensor import RadarSensor
from twin.world.kernel_loading import load_kernels
from twin.world.mirror import Mirror

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_AZIMUTHS = wp.constant(AZIMUTHS)


@wp.kernel
def cube_kernel(
    # model
    model: RadarModel,
    steps: wp.array(dtype=wp.vec2),
    # state in
    slots: wp.array(dtype=RadarSlot),
    near: wp.array2d(dtype=wp.float64),
    by_speed: wp.array2d(dtype=wp.float64),
    touched: wp.array(dtype=wp.uint8),
    signals: wp.array2d(dtype=wp.vec2),
    power: wp.array3d(dtype=wp.float32),
    # out
    cube_out: wp.array4d(dtype=wp.float32),
):
    """Powers of the beams over their thermal noise [S, ranges, speeds, azimuths]; threads over
    (slot, range, speed). ``steps``: factor from a column to the next of each beam, conjugate."""
    slot, row, speed = wp.tid()
    state = slots[slot]
    if state.active == 0:
        return
    x = antennas_of(
        model, state, near, by_speed, touched, signals, slot, speed, row, power[slot, speed, row]
    )
    for k in range(_AZIMUTHS):
        step = steps[k]
        weight = wp.vec2(1.0, 0.0)
        total = wp.vec2(0.0, 0.0)
        for a in range(model.columns):
            total = total + complex_product(wp.vec2(x[2 * a], x[2 * a + 1]), weight)
            weight = complex_product(weight, step)
        cube_out[slot, row, speed, k] = wp.dot(total, total) / wp.float32(model.columns)


def beam_turns() -> np.ndarray:
    """Phase from column to column of each beam [turns], float64 [AZIMUTHS]."""
    return (np.arange(AZIMUTHS) + 0.5) / AZIMUTHS - 0.5


class RadarCubes:
    """Cubes of all slots, whatever radar each has."""

    def __init__(self, slots: int, device: wp.Device, out: np.ndarray | None = None) -> None:
        """``out``: float32 [S, RANGES, SPEEDS, AZIMUTHS] host buffer that receives them."""
        self._device = device
        angle = -2.0 * math.pi * beam_turns()
        steps = steady(np.stack([np.cos(angle), np.sin(angle)], axis=1), 40)
        self._steps = wp.array(steps, dtype=wp.vec2, device=device)
        self.cube = Mirror((slots, RANGES, SPEEDS, AZIMUTHS), wp.float32, device, out, large=True)
        load_kernels(device, [cube_kernel, detect])

    def clear(self) -> None:
        """Zeros everywhere."""
        self.cube.device.zero_()

    def take(self, sensor: RadarSensor) -> None:
        """The last measurement of ``sensor``, in the slots that have it.

        Raises:
            ValueError: it has more cells than a cube; one line.
        """
        profile = sensor.profile
        if profile.samples > RANGES or profile.chirps > SPEEDS:
            raise ValueError(
                f"radar profile {profile.radar}: {profile.samples} samples x {profile.chirps} "
                f"chirps, but a cube has at most {RANGES} x {SPEEDS}"
            )
        slots = self.cube.device.shape[0]
        wp.launch(
            cube_kernel,
            (slots, profile.samples, profile.chirps),
            inputs=[sensor.model, self._steps, *sensor.cells],
            outputs=[self.cube.device],
            device=self._device,
        )
