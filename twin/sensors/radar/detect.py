"""Detections: where a peak lies between cells, and from which directions it comes.

The array's answer to a peak is searched with beams over the sine of the azimuth. The strongest is
made more exact on a parabola, taken out of the antennas' signals, and a second one is looked for
in what is left (CLEAN, Hogbom 1974): so a guard rail on the left and one on the right, which share
range and speed, stay two. The elevation follows from the phase between the two rows.
"""

from __future__ import annotations

import math

import warp as wp

from twin.base.portable.whole import whole_within_f32
from twin.base.portable_math import portable_asin, portable_atan2, portable_log
from twin.sensors.radar.echo import (
    RadarModel,
    RadarSlot,
    complex_product,
    phasor,
    two_way_gain,
)
from twin.sensors.radar.peaks import level_of
from twin.sensors.radar.profile import COLUMNS_MAX
from twin.sensors.radar.spectrum import cell_of, noise_bits, noise_of, variance_of, window_at
from twin.sensors.radar.window import PLACES

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BEAMS = 64
"""Beams of the search, even in the sine of the azimuth."""
PER_PEAK = 2
"""Most detections of a peak."""

_BEAMS, _PER_PEAK, _PLACES = (wp.constant(n) for n in (BEAMS, PER_PEAK, PLACES))
_ANTENNAS = 2 * COLUMNS_MAX
_ZERO = wp.constant(wp.float64(0.0))
_HALF = wp.constant(wp.float64(0.5))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_TWO_PI = wp.constant(wp.float64(2.0 * math.pi))
_DB = wp.constant(wp.float64(10.0 / math.log(10.0)))
_TINY = wp.constant(1.0e-20)
_SECOND_TO_FIRST = wp.constant(0.01)
_SECOND_TO_LEVEL = wp.constant(20.0)

Signals = wp.types.vector(length=2 * _ANTENNAS, dtype=wp.float32)
"""Complex signals of the antennas, real and imaginary parts in turn."""


@wp.struct
class RadarDetection:
    """One detection; kept 0: none."""

    kept: wp.int32
    row: wp.int32
    range_m: wp.float32
    azimuth_rad: wp.float32
    elevation_rad: wp.float32
    speed_mps: wp.float32
    rcs_dbsm: wp.float32
    snr_db: wp.float32


@wp.func
def place_of(
    low: wp.float32,
    middle: wp.float32,
    high: wp.float32,
    places: wp.array(dtype=wp.float32),
    limit: wp.float32,
) -> wp.float32:
    """Offset of a peak from its middle cell, by the powers of it and of its neighbours [cells]."""
    a = portable_log(wp.float64(wp.max(low, _TINY)))
    b = portable_log(wp.float64(wp.max(middle, _TINY)))
    c = portable_log(wp.float64(wp.max(high, _TINY)))
    bend = a - _TWO * b + c
    if bend >= _ZERO:
        return 0.0
    apex = wp.float32(_HALF * (a - c) / bend)
    place = (wp.clamp(apex, -limit, limit) / limit + 1.0) * 0.5 * wp.float32(_PLACES - 1)
    row = whole_within_f32(place, 0, _PLACES - 2)
    share = place - wp.float32(row)
    return places[row] * (1.0 - share) + places[row + 1] * share


@wp.func
def beam(signals: Signals, first: wp.int32, count: wp.int32, turns: wp.float64) -> wp.vec2:
    """Mean of ``count`` antennas from ``first`` on, each turned back by its share of ``turns``."""
    step = phasor(-turns)
    weight = wp.vec2(1.0, 0.0)
    total = wp.vec2(0.0, 0.0)
    for a in range(count):
        value = wp.vec2(signals[2 * (first + a)], signals[2 * (first + a) + 1])
        total = total + complex_product(value, weight)
        weight = complex_product(weight, step)
    return total / wp.float32(count)


@wp.func
def _beam_power(signals: Signals, count: wp.int32, turns: wp.float64) -> wp.float32:
    value = beam(signals, 0, count, turns)
    return wp.dot(value, value)


@wp.func
def strongest_turns(model: RadarModel, signals: Signals) -> wp.float64:
    """Phase from column to column of the strongest beam [turns]; half a turn is the end."""
    best = wp.int32(0)
    most = wp.float32(-1.0)
    for k in range(_BEAMS):
        turns = (wp.float64(k) + _HALF) / wp.float64(_BEAMS) - _HALF
        power = _beam_power(signals, model.columns, turns)
        if power > most:
            most = power
            best = k
    turns = (wp.float64(best) + _HALF) / wp.float64(_BEAMS) - _HALF
    step = wp.float64(0.5) / wp.float64(_BEAMS)
    for _i in range(4):
        low = _beam_power(signals, model.columns, turns - step)
        middle = _beam_power(signals, model.columns, turns)
        high = _beam_power(signals, model.columns, turns + step)
        bend = low - 2.0 * middle + high
        if bend < 0.0:
            move = wp.float64(0.5 * (low - high) / bend)
            turns = turns + wp.clamp(move, -_TWO, _TWO) * step
        step = step * _HALF
    return turns


@wp.func
def without(
    model: RadarModel, signals: Signals, turns: wp.float64, part: wp.vec2, lift: wp.vec2
) -> Signals:
    """Signals less those of a source: ``part`` at the first antenna, ``lift`` at the first of the
    upper row."""
    step = phasor(turns)
    rest = signals
    value = part
    for a in range(model.columns):
        rest[2 * a] = rest[2 * a] - value[0]
        rest[2 * a + 1] = rest[2 * a + 1] - value[1]
        value = complex_product(value, step)
    value = lift
    for b in range(model.upper):
        a = model.columns + b
        rest[2 * a] = rest[2 * a] - value[0]
        rest[2 * a + 1] = rest[2 * a + 1] - value[1]
        value = complex_product(value, step)
    return rest


@wp.func
def _detection(
    model: RadarModel,
    row: wp.int32,
    range_place: wp.float32,
    speed_place: wp.float32,
    straddle: wp.float32,
    level: wp.float32,
    turns: wp.float64,
    part: wp.vec2,
    lift: wp.vec2,
) -> RadarDetection:
    """Detection of a source whose signals were found."""
    found = RadarDetection()
    y = turns / model.spacing
    z = _ZERO
    if model.upper > 0:
        across = complex_product(lift, wp.vec2(part[0], -part[1]))
        angle = portable_atan2(wp.float64(across[1]), wp.float64(across[0]))
        z = angle / (_TWO_PI * model.lift)
    ahead = _ONE - y * y - z * z
    if ahead <= _ZERO:
        return found
    azimuth = portable_atan2(y, wp.sqrt(ahead))
    if wp.abs(azimuth) > model.half_view:
        return found
    elevation = portable_asin(z)
    distance = wp.float64(range_place) * model.range_cell
    if distance <= _ZERO:
        return found
    power = wp.float64(wp.max(wp.dot(part, part), _TINY))
    square = distance * distance
    scale = model.signal * two_way_gain(model, azimuth, elevation) / (square * square)
    scale = scale * wp.float64(straddle) * wp.float64(straddle)
    found.kept = 1
    found.row = row
    found.range_m = wp.float32(distance)
    found.azimuth_rad = wp.float32(azimuth)
    found.elevation_rad = wp.float32(elevation)
    found.speed_mps = wp.float32(model.speed_min + wp.float64(speed_place) * model.speed_cell)
    found.rcs_dbsm = wp.float32(_DB * portable_log(power / scale))
    antennas = wp.float64(model.columns + model.upper)
    found.snr_db = wp.float32(_DB * portable_log(power * antennas / wp.float64(level)))
    return found


@wp.func
def antennas_of(
    model: RadarModel,
    state: RadarSlot,
    near: wp.array2d(dtype=wp.float64),
    by_speed: wp.array2d(dtype=wp.float64),
    touched: wp.array(dtype=wp.uint8),
    signals: wp.array2d(dtype=wp.vec2),
    slot: wp.int32,
    speed: wp.int32,
    row: wp.int32,
    power: wp.float32,
) -> Signals:
    """Signals of the antennas in a cell of mean ``power``; of noise alone they are scaled to it."""
    x = Signals()
    cell = cell_of(model, slot, speed, row)
    there = touched[cell] != wp.uint8(0)
    variance = variance_of(state, near, by_speed, slot, speed, row)
    total = wp.float32(0.0)
    for a in range(model.columns + model.upper):
        value = wp.vec2(0.0, 0.0)
        if there:
            value = signals[cell, a]
        if state.noise != 0:
            value = value + noise_of(noise_bits(model, state, a, speed, row), variance)
        total += wp.dot(value, value)
        x[2 * a] = value[0]
        x[2 * a + 1] = value[1]
    if not there and total > 0.0:
        scale = wp.sqrt(power * wp.float32(model.columns + model.upper) / total)
        for k in range(2 * (model.columns + model.upper)):
            x[k] = x[k] * scale
    return x


@wp.kernel
def detect_kernel(
    # model
    model: RadarModel,
    # state in
    slots: wp.array(dtype=RadarSlot),
    near: wp.array2d(dtype=wp.float64),
    by_speed: wp.array2d(dtype=wp.float64),
    touched: wp.array(dtype=wp.uint8),
    signals: wp.array2d(dtype=wp.vec2),
    power: wp.array3d(dtype=wp.float32),
    peaks: wp.array2d(dtype=wp.int32),
    total: wp.array(dtype=wp.int32),
    # out
    found_out: wp.array2d(dtype=RadarDetection),
):
    """Detections of each peak [S, PEAKS_MAX x PER_PEAK]."""
    slot, number = wp.tid()
    if number >= total[slot]:
        return
    state = slots[slot]
    row = peaks[slot, number] / model.speeds
    speed = peaks[slot, number] - row * model.speeds
    here = power[slot, speed, row]
    x = antennas_of(model, state, near, by_speed, touched, signals, slot, speed, row, here)
    below = (speed + model.speeds - 1) % model.speeds
    above = (speed + 1) % model.speeds
    level = level_of(power, slot, speed, row)
    if state.noise != 0:
        level = level / model.level_mean
    # Noise lies below the powers of all three cells.
    off_range = place_of(
        wp.max(power[slot, speed, row - 1] - level, 0.01 * level),
        wp.max(here - level, 0.01 * level),
        wp.max(power[slot, speed, row + 1] - level, 0.01 * level),
        model.range_places,
        model.place_limit,
    )
    off_speed = place_of(
        wp.max(power[slot, below, row] - level, 0.01 * level),
        wp.max(here - level, 0.01 * level),
        wp.max(power[slot, above, row] - level, 0.01 * level),
        model.speed_places,
        model.place_limit,
    )
    straddle = window_at(model.range_window, off_range) * window_at(model.speed_window, off_speed)
    range_place = wp.float32(row) + off_range
    speed_place = wp.float32(speed) + off_speed
    strength = wp.float32(0.0)
    for source in range(_PER_PEAK):
        turns = strongest_turns(model, x)
        part = beam(x, 0, model.columns, turns)
        lift = part
        if model.upper > 0:
            lift = beam(x, model.columns, model.upper, turns)
        size = wp.dot(part, part)
        found = RadarDetection()
        good = source == 0
        if source > 0:
            ratio = size * wp.float32(model.columns + model.upper) / level
            good = size > _SECOND_TO_FIRST * strength and ratio > _SECOND_TO_LEVEL
        if good:
            found = _detection(
                model, row, range_place, speed_place, straddle, level, turns, part, lift
            )
        found_out[slot, number * _PER_PEAK + source] = found
        strength = size
        x = without(model, x, turns, part, lift)


@wp.kernel
def keep_kernel(
    # args
    most: wp.int32,
    # state in
    found: wp.array2d(dtype=RadarDetection),
    total: wp.array(dtype=wp.int32),
    # out
    kept_out: wp.array2d(dtype=wp.int32),
):
    """1 for the ``most`` detections of the highest signal-to-noise ratio [S, N]."""
    slot, number = wp.tid()
    count = total[slot] * _PER_PEAK
    if number >= count:
        return
    kept = found[slot, number].kept
    if kept != 0:
        here = found[slot, number].snr_db
        better = wp.int32(0)
        for other in range(count):
            if found[slot, other].kept != 0:
                there = found[slot, other].snr_db
                if there > here or (there == here and other < number):
                    better += 1
        if better >= most:
            kept = wp.int32(0)
    kept_out[slot, number] = kept


@wp.kernel
def emit_kernel(
    # state in
    found: wp.array2d(dtype=RadarDetection),
    total: wp.array(dtype=wp.int32),
    kept: wp.array2d(dtype=wp.int32),
    # out
    rows_out: wp.array3d(dtype=wp.float32),
    count_out: wp.array(dtype=wp.int32),
):
    """Rows of what is kept [S, N, 6], by range cell, then azimuth; and how many [S]."""
    slot, number = wp.tid()
    count = total[slot] * _PER_PEAK
    if number >= count or kept[slot, number] == 0:
        return
    mine = found[slot, number]
    place = wp.int32(0)
    kept_total = wp.int32(0)
    for other in range(count):
        if kept[slot, other] != 0:
            kept_total += 1
            row = found[slot, other].row
            azimuth = found[slot, other].azimuth_rad
            before = row < mine.row
            if row == mine.row:
                before = azimuth < mine.azimuth_rad
                if azimuth == mine.azimuth_rad:
                    before = other < number
            if before:
                place += 1
    rows_out[slot, place, 0] = mine.range_m
    rows_out[slot, place, 1] = mine.azimuth_rad
    rows_out[slot, place, 2] = mine.elevation_rad
    rows_out[slot, place, 3] = mine.speed_mps
    rows_out[slot, place, 4] = mine.rcs_dbsm
    rows_out[slot, place, 5] = mine.snr_db
    if place == 0:
        count_out[slot] = kept_total
