"""Echoes: what a scatterer adds to the range-Doppler map of every antenna, and the radar itself.

Positions are in the radar's axes, x forward, y left, z up. A point at distance R whose radar cross
section is s gives the signal over noise K G^2 s / R^4 e^{-2 a R} in a cell of one antenna, at the
cell R / (c / 2 B) and the speed cell (v - v_min) / (lambda / 2 N T), folded. Its phase is
-4 pi R / lambda; from column to column it grows by 2 pi d y / R, to the upper row by 2 pi h z / R.
"""

from __future__ import annotations

import math

import warp as wp

from twin.base.portable_math import (
    portable_asin,
    portable_atan2,
    portable_cos,
    portable_exp,
    portable_sin,
)
from twin.sensors.radar.profile import RadarProfile
from twin.sensors.radar.threshold import factor, level_mean, power_table
from twin.sensors.radar.window import PLACES, chebyshev, loss, places, table

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FAINT = wp.constant(1.0e-3)
"""Signal over noise in a cell of one antenna below which nothing is added: 30 dB below the noise
of that antenna."""

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_TWO_PI = wp.constant(wp.float64(2.0 * math.pi))
_NEAREST_M = wp.constant(wp.float64(0.2))


@wp.struct
class RadarModel:
    """What all slots share."""

    ranges: wp.int32
    speeds: wp.int32
    """Cells."""
    columns: wp.int32
    upper: wp.int32
    first_row: wp.int32
    last_row: wp.int32
    """Range cells in which something may be detected."""
    signal: wp.float64
    """Signal over noise of 1 m^2 at 1 m in the axis, in a cell of one antenna [-]."""
    wavelength: wp.float64
    """[m]"""
    range_cell: wp.float64
    """[m]"""
    speed_cell: wp.float64
    """[m/s]"""
    speed_min: wp.float64
    """[m/s]"""
    spacing: wp.float64
    lift: wp.float64
    """[wavelengths]"""
    beam: wp.vec2d
    """Falls of the gain over angles squared: one way, azimuth and elevation, power [1/rad^2]."""
    floor: wp.vec2d
    """Least gains, one way [-]."""
    half_view: wp.float64
    """Azimuth [rad]."""
    factor: wp.float32
    level_mean: wp.float32
    noise_power: wp.array(dtype=wp.float32)
    """See :func:`twin.sensors.radar.threshold.power_table`."""
    range_window: wp.array(dtype=wp.float32)
    speed_window: wp.array(dtype=wp.float32)
    range_places: wp.array(dtype=wp.float32)
    speed_places: wp.array(dtype=wp.float32)
    place_limit: wp.float32


@wp.struct
class RadarSlot:
    """What a slot's radar is in; host-filled."""

    active: wp.int32
    tick: wp.int32
    """Case tick."""
    key: wp.uint64
    noise: wp.int32
    """1: thermal noise and echoes of rain."""
    multipath: wp.int32
    clutter: wp.int32
    attenuation: wp.float64
    """Of power, one way [1/m]."""
    rain_echo: wp.float64
    """[m^2/m^3]"""
    wetness: wp.float64
    """Water on surfaces, 0 dry, 1 a closed film [-]."""
    position: wp.vec3d
    """In vehicle axes [m]."""
    yaw: wp.vec2d
    """Cosine and sine of where it looks, in vehicle axes."""


@wp.struct
class RadarPose:
    """Where a slot's radar is and how it moves."""

    origin: wp.vec3d
    """World [m]."""
    rotation: wp.mat33d
    """world_from_radar."""
    velocity: wp.vec3d
    """World [m/s]."""
    ground: wp.float64
    """World z of the road below the vehicle [m]."""


@wp.struct
class RadarEcho:
    """What a scatterer adds; power 0: nothing."""

    power: wp.float32
    """Signal over noise in a cell of one antenna [-]."""
    row: wp.float32
    """Range [cells]."""
    column: wp.float32
    """Speed [cells], folded: from 0 to the number of cells."""
    signal: wp.vec2
    """Complex amplitude at the first antenna."""
    step: wp.vec2
    """Factor from a column to the next."""
    up: wp.vec2
    """Factor from the lower row to the upper."""


@wp.func
def two_way_gain(model: RadarModel, azimuth: wp.float64, elevation: wp.float64) -> wp.float64:
    """Product of the gains of transmitter and receiver relative to the axis [-]."""
    across = portable_exp(-model.beam[0] * azimuth * azimuth)
    upright = portable_exp(-model.beam[1] * elevation * elevation)
    one_way = wp.max(across, model.floor[0]) * wp.max(upright, model.floor[1])
    return one_way * one_way


@wp.func
def phasor(turns: wp.float64) -> wp.vec2:
    """Unit complex number at so many turns."""
    angle = _TWO_PI * (turns - wp.floor(turns))
    return wp.vec2(wp.float32(portable_cos(angle)), wp.float32(portable_sin(angle)))


@wp.func
def power_of(
    model: RadarModel, slot: RadarSlot, at: wp.vec3d, cross_section: wp.float64
) -> wp.float64:
    """Signal over noise of ``cross_section`` [m^2] at ``at`` [m]; 0: out of sight."""
    distance = wp.length(at)
    if distance < _NEAREST_M or at[0] <= _ZERO:
        return _ZERO
    if distance > wp.float64(model.ranges - 1) * model.range_cell:
        return _ZERO
    azimuth = portable_atan2(at[1], at[0])
    elevation = portable_asin(at[2] / distance)
    square = distance * distance
    weakened = portable_exp(-_TWO * slot.attenuation * distance)
    gain = two_way_gain(model, azimuth, elevation)
    return model.signal * gain * cross_section * weakened / (square * square)


@wp.func
def echo_of(
    model: RadarModel,
    power: wp.float64,
    at: wp.vec3d,
    radial_speed: wp.float64,
    turns: wp.float64,
) -> RadarEcho:
    """Echo of ``power`` from ``at`` [m], with ``turns`` of phase besides that of its way."""
    distance = wp.length(at)
    echo = RadarEcho()
    echo.power = wp.float32(power)
    echo.row = wp.float32(distance / model.range_cell)
    cell = (radial_speed - model.speed_min) / model.speed_cell
    count = wp.float64(model.speeds)
    echo.column = wp.float32(cell - count * wp.floor(cell / count))
    start = phasor(turns - _TWO * distance / model.wavelength)
    echo.signal = start * wp.float32(wp.sqrt(power))
    echo.step = phasor(model.spacing * at[1] / distance)
    echo.up = phasor(model.lift * at[2] / distance)
    return echo


@wp.func
def complex_product(a: wp.vec2, b: wp.vec2) -> wp.vec2:
    """a b of complex numbers."""
    return wp.vec2(a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0])


def make_model(profile: RadarProfile, device: wp.Device) -> RadarModel:
    """Constants and tables of ``profile`` on ``device``."""
    model = RadarModel()
    windows = [chebyshev(n, profile.sidelobe_db) for n in (profile.samples, profile.chirps)]
    model.ranges, model.speeds = profile.samples, profile.chirps
    model.columns, model.upper = profile.columns, profile.upper
    model.first_row = max(1, round(profile.range_min_m / profile.range_cell_m))
    model.last_row = min(profile.samples - 2, int(profile.range_max_m / profile.range_cell_m))
    model.signal = profile.signal_at_1_m * loss(windows[0]) * loss(windows[1])
    model.wavelength, model.range_cell = profile.wavelength_m, profile.range_cell_m
    model.speed_cell, model.speed_min = profile.speed_cell_mps, profile.speed_min_mps
    model.spacing, model.lift = profile.spacing, profile.lift
    # Half power at half the width: exp(-b (w / 2)^2) = 1 / 2.
    falls = [4.0 * math.log(2.0) / math.radians(width) ** 2 for width in profile.beam_deg]
    model.beam = wp.vec2d(*falls)
    model.floor = wp.vec2d(*(10.0 ** (db / 10.0) for db in profile.floor_db))
    model.half_view = math.radians(profile.half_view_deg[0])
    model.factor = factor(profile.false_alarm_rate, profile.antennas)
    model.level_mean = level_mean(profile.antennas)

    def upload(values: object) -> wp.array:
        return wp.array(values, dtype=wp.float32, device=device)

    model.noise_power = upload(power_table(profile.antennas))
    model.range_window, model.speed_window = (upload(table(window)) for window in windows)
    (range_places, limit), (speed_places, _) = (places(window) for window in windows)
    model.range_places, model.speed_places = upload(range_places), upload(speed_places)
    model.place_limit = limit
    assert len(range_places) == PLACES
    return model
