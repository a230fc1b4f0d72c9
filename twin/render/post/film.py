"""The last step, from linear light to 8 bits: all that touches a pixel by itself, in one kernel.

In the order of the light: chromatic aberration (the lens draws red larger and blue smaller), bloom
(mixed in), vignette, gain, grain, the noise of the sensor, tone.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import warp as wp

from schemas.sections.lens import Lens
from schemas.sections.lens_curve import intrinsics
from twin.render.lens import ray_table
from twin.render.light.light import SlotLight
from twin.render.noise import draw, normal
from twin.render.post.pixels import between, between_one, corners, load
from twin.render.sensor_noise import sensor_noise
from twin.render.tone import tone


@wp.struct
class FilmConstants:
    """Constants of the last step."""

    centre_x: wp.float32
    """Place at which the optical axis meets the image, whole numbers being pixel centres [px]."""
    centre_y: wp.float32
    """[px]"""
    red_scale: wp.float32
    """Distance from the centre at which red is read, over that at which it is drawn [-]."""
    blue_scale: wp.float32
    bloom: wp.float32
    """Share of scattered light [-]."""
    grain: wp.float32
    """Standard deviation, relative to a dark signal [-]."""


def film_of(lens: Lens, height: int, width: int, hfov_deg: float) -> FilmConstants:
    """The constants of a lens for an image."""
    inner = intrinsics(lens, width, height, hfov_deg)
    film = FilmConstants()
    film.centre_x, film.centre_y = inner.cx_px - 0.5, inner.cy_px - 0.5
    film.red_scale = 1.0 / (1.0 + lens.chromatic_aberration)
    film.blue_scale = 1.0 / (1.0 - lens.chromatic_aberration)
    film.bloom = lens.bloom
    film.grain = lens.grain
    return film


def falloff(lens: Lens, height: int, width: int, hfov_deg: float) -> np.ndarray:
    """Share of the light that the vignette lets through, float32 [H, W].

    1 - v (1 - cos^4 theta) with v = ``lens.vignette`` and the angle theta off the optical axis
    (natural vignetting, in any textbook of optics; 0 from 90 degrees on).
    """
    cosine = np.maximum(ray_table(lens, width, height, hfov_deg)[:, :, 2].astype(np.float64), 0.0)
    return (1.0 - lens.vignette * (1.0 - cosine**4)).astype(np.float32)


@cache
def film_kernel(fringes: bool, bloom: bool, vignette: bool, grain: bool) -> wp.Kernel:
    """The last step with the given effects; compiled once per set."""

    @wp.kernel(enable_backward=False, module="unique", module_options={"fuse_fp": False})
    def film_kernel(
        # model
        film: FilmConstants,
        table: wp.array(dtype=wp.uint8),
        passed: wp.array2d(dtype=wp.float32),
        gain: wp.array(dtype=wp.float32),
        # state in
        lights: wp.array(dtype=SlotLight),
        image: wp.array4d(dtype=wp.float16),
        scattered: wp.array4d(dtype=wp.float16),
        # out
        image_out: wp.array4d(dtype=wp.uint8),
    ):
        slot, row, column = wp.tid()
        light = lights[slot]
        if light.active == 0:
            return
        height = image.shape[1]
        width = image.shape[2]
        signal = load(image, slot, row, column)
        if wp.static(fringes):
            y = wp.float32(row) - film.centre_y
            x = wp.float32(column) - film.centre_x
            red = corners(
                y * film.red_scale + film.centre_y,
                x * film.red_scale + film.centre_x,
                height,
                width,
            )
            blue = corners(
                y * film.blue_scale + film.centre_y,
                x * film.blue_scale + film.centre_x,
                height,
                width,
            )
            signal = wp.vec3(
                between_one(image, slot, red, 0), signal[1], between_one(image, slot, blue, 2)
            )
        if wp.static(bloom):
            y = 0.5 * wp.float32(row) - 0.25
            x = 0.5 * wp.float32(column) - 0.25
            wide = between(scattered, slot, corners(y, x, scattered.shape[1], scattered.shape[2]))
            signal = signal * (1.0 - film.bloom) + wide * film.bloom
        if wp.static(vignette):
            signal = signal * passed[row, column]
        signal = signal * gain[slot]
        pixel = row * width + column
        if wp.static(grain):
            # Numbers after those of the sensor's noise; one for all channels, as silver has.
            number = normal(draw(light.key, light.tick, 3 * height * width + pixel))
            for channel in range(3):
                x = signal[channel]
                signal[channel] = x + film.grain * number * x / (1.0 + wp.max(x, 0.0))
        for channel in range(3):
            x = signal[channel]
            if light.noise != 0:
                x = sensor_noise(x, light.key, light.tick, pixel * 3 + channel)
            image_out[slot, row, column, channel] = tone(x, table)

    return film_kernel
