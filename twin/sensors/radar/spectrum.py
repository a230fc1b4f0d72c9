"""The range-Doppler map: echoes of all scatterers in every antenna, and noise.

Instead of samples and their Fourier transform, each echo is added where the transform would show
it: in the cells within reach of its main lobe, by the windows' response
(:mod:`twin.sensors.radar.window`). Echoes are first listed by groups of eight range cells; then a
thread has a range cell of a slot and meets the echoes of its group in their order, so the sums have
one order on every device.

Noise is a complex normal number per cell and antenna, by counter: with u and v uniform, its power
is -ln u and its phase 2 pi v (Box and Muller 1958). A cell without echoes needs no phases: its
power over all M antennas is a gamma variable of shape M, drawn at once by a table of its quantiles.
Where such a cell is a peak, its antennas get normal numbers scaled to that power, which is the same
distribution: the direction of a vector of normal numbers does not depend on its length.
"""

from __future__ import annotations

import math

import warp as wp

from twin.base.portable.whole import whole_within, whole_within_f32
from twin.base.portable_math import portable_cos, portable_exp, portable_log, portable_sin
from twin.render.noise import draw
from twin.sensors.radar.echo import (
    FAINT,
    RadarEcho,
    RadarModel,
    RadarPose,
    RadarSlot,
    complex_product,
)
from twin.sensors.radar.threshold import POWER_END, POWER_ROWS
from twin.sensors.radar.window import REACH, STEPS

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

GROUP = 8
"""Range cells of a group in which echoes are listed."""
SPEEDS = 8
"""Speed cells of a thread: on a CPU a thread costs as much as a few cells."""

_SPAN = wp.constant(2 * REACH)
Cells = wp.types.vector(length=2 * REACH, dtype=wp.int32)
Weights = wp.types.vector(length=2 * REACH, dtype=wp.float32)

_SPEEDS = wp.constant(SPEEDS)
_REACH = wp.constant(REACH)
_GROUP, _ROWS = wp.constant(GROUP), wp.constant(POWER_ROWS)
_STEPS = wp.constant(float(STEPS))
_S32 = wp.constant(wp.uint64(32))
_LOW = wp.constant(wp.uint64(0xFFFFFFFF))
_UNIT = wp.constant(wp.float64(2.0**-32))
_HALF = wp.constant(wp.float64(0.5))
_ONE = wp.constant(wp.float64(1.0))
_ZERO = wp.constant(wp.float64(0.0))
_TWO = wp.constant(wp.float64(2.0))
_LN_2 = wp.constant(wp.float64(math.log(2.0)))
_ROWS_PER_NEPER = wp.constant(wp.float64(POWER_ROWS / (POWER_END - math.log(2.0))))
_TWO_PI = wp.constant(wp.float64(2.0 * math.pi))


@wp.func
def window_at(window: wp.array(dtype=wp.float32), offset: wp.float32) -> wp.float32:
    """Response ``offset`` cells from a tone, between the table's rows on straight lines."""
    place = wp.abs(offset) * _STEPS
    row = whole_within_f32(place, 0, window.shape[0] - 2)
    share = place - wp.float32(row)
    return window[row] * (1.0 - share) + window[row + 1] * share


@wp.func
def _near_group(echo_row: wp.float32, group: wp.int32) -> wp.bool:
    """Whether an echo at ``echo_row`` reaches into a group of range cells."""
    first = wp.float32(group * _GROUP - _REACH)
    return echo_row > first and echo_row < first + wp.float32(_GROUP - 1 + 2 * _REACH)


@wp.kernel
def group_kernel(
    # state in
    slots: wp.array(dtype=RadarSlot),
    echoes: wp.array2d(dtype=RadarEcho),
    # out
    count_out: wp.array2d(dtype=wp.int32),
):
    """Echoes that reach into each group of :data:`GROUP` range cells [S, groups]."""
    slot, group = wp.tid()
    if slots[slot].active == 0:
        return
    count = wp.int32(0)
    for number in range(echoes.shape[1]):
        if echoes[slot, number].power > FAINT and _near_group(echoes[slot, number].row, group):
            count += 1
    count_out[slot, group] = count


@wp.kernel
def member_kernel(
    # state in
    slots: wp.array(dtype=RadarSlot),
    echoes: wp.array2d(dtype=RadarEcho),
    count: wp.array2d(dtype=wp.int32),
    # out
    first_out: wp.array2d(dtype=wp.int32),
    member_out: wp.array2d(dtype=wp.int32),
):
    """Numbers of each group's echoes, in their order [S, 2 N], and where each begins [S, groups].

    An echo reaches over less than eight cells, so into two groups at most.
    """
    slot, group = wp.tid()
    if slots[slot].active == 0:
        return
    place = wp.int32(0)
    for before in range(group):
        place += count[slot, before]
    first_out[slot, group] = place
    for number in range(echoes.shape[1]):
        if echoes[slot, number].power > FAINT and _near_group(echoes[slot, number].row, group):
            member_out[slot, place] = number
            place += 1


@wp.func
def _add(
    signal: wp.vec2,
    antenna: wp.int32,
    cells: Cells,
    weights: Weights,
    map_out: wp.array2d(dtype=wp.vec2),
):
    """Add ``signal`` to an antenna's cells, by their weights."""
    for k in range(_SPAN):
        if weights[k] != 0.0:
            cell = cells[k]
            map_out[cell, antenna] = map_out[cell, antenna] + signal * weights[k]


@wp.kernel
def map_kernel(
    # model
    model: RadarModel,
    # state in
    slots: wp.array(dtype=RadarSlot),
    echoes: wp.array2d(dtype=RadarEcho),
    count: wp.array2d(dtype=wp.int32),
    first: wp.array2d(dtype=wp.int32),
    member: wp.array2d(dtype=wp.int32),
    # state in and out
    touched: wp.array(dtype=wp.uint8),
    # out
    map_out: wp.array2d(dtype=wp.vec2),
):
    """Signals [S x speeds x ranges, antennas]; ``touched`` [S x speeds x ranges] must be zeros, and
    cells where it stays 0 keep what was there."""
    slot, row = wp.tid()
    if slots[slot].active == 0:
        return
    group = row / _GROUP
    start = first[slot, group]
    for place in range(count[slot, group]):
        number = member[slot, start + place]
        offset = wp.float32(row) - echoes[slot, number].row
        if wp.abs(offset) >= wp.float32(_REACH):
            continue
        echo = echoes[slot, number]
        here = window_at(model.range_window, offset)
        if echo.power * here * here <= FAINT:
            continue
        lowest = whole_within_f32(wp.floor(echo.column), 0, model.speeds) - _REACH + 1
        cells = Cells()
        weights = Weights()
        for k in range(_SPAN):
            speed = lowest + k
            there = window_at(model.speed_window, wp.float32(speed) - echo.column) * here
            if echo.power * there * there > FAINT:
                folded = (speed + model.speeds) % model.speeds
                cell = cell_of(model, slot, folded, row)
                cells[k] = cell
                weights[k] = there
                if touched[cell] == wp.uint8(0):
                    touched[cell] = wp.uint8(1)
                    for a in range(model.columns + model.upper):
                        map_out[cell, a] = wp.vec2(0.0, 0.0)
        lower = echo.signal
        for a in range(model.columns):
            _add(lower, a, cells, weights, map_out)
            lower = complex_product(lower, echo.step)
        higher = complex_product(echo.signal, echo.up)
        for b in range(model.upper):
            _add(higher, model.columns + b, cells, weights, map_out)
            higher = complex_product(higher, echo.step)


@wp.func
def cell_of(model: RadarModel, slot: wp.int32, speed: wp.int32, row: wp.int32) -> wp.int32:
    """Place of a cell in the arrays over all slots' cells."""
    return (slot * model.speeds + speed) * model.ranges + row


@wp.func
def first_uniform(bits: wp.uint64) -> wp.float64:
    """Uniform number in (0, 1) from the upper half of 64 bits."""
    return (wp.float64(bits >> _S32) + _HALF) * _UNIT


@wp.func
def noise_of(bits: wp.uint64, variance: wp.float64) -> wp.vec2:
    """Complex normal number of ``variance``."""
    size = wp.sqrt(-variance * portable_log(first_uniform(bits)))
    angle = _TWO_PI * (wp.float64(bits & _LOW) * _UNIT)
    return wp.vec2(wp.float32(size * portable_cos(angle)), wp.float32(size * portable_sin(angle)))


@wp.func
def noise_bits(
    model: RadarModel, state: RadarSlot, antenna: wp.int32, speed: wp.int32, row: wp.int32
) -> wp.uint64:
    """Random bits of a cell of an antenna."""
    cell = (antenna * model.speeds + speed) * model.ranges + row
    return draw(state.key, state.tick, cell)


@wp.kernel
def rain_kernel(
    # model
    model: RadarModel,
    solid_angle: wp.float64,
    fall: wp.float64,
    # state in
    slots: wp.array(dtype=RadarSlot),
    poses: wp.array(dtype=RadarPose),
    # out
    near_out: wp.array2d(dtype=wp.float64),
    speed_out: wp.array2d(dtype=wp.float64),
):
    """Echo of rain over thermal noise: by range cell [S, ranges], and its share of each speed cell
    [S, speeds]. ``solid_angle``: of the two-way beam [sr]; ``fall``: standard deviation of the
    drops' radial speeds [m/s]."""
    slot, cell = wp.tid()
    state = slots[slot]
    if state.active == 0 or state.rain_echo <= _ZERO:
        return
    if cell < model.ranges:
        far = (wp.float64(cell) + _HALF) * model.range_cell
        volume = far * far * solid_angle * model.range_cell
        weakened = portable_exp(-_TWO * state.attenuation * far)
        square = far * far
        near_out[slot, cell] = (
            model.signal * state.rain_echo * volume * weakened / (square * square)
        )
    if cell < model.speeds:
        pose = poses[slot]
        ahead = wp.vec3d(pose.rotation[0, 0], pose.rotation[1, 0], pose.rotation[2, 0])
        radial = -wp.dot(pose.velocity, ahead)
        away = model.speed_min + wp.float64(cell) * model.speed_cell - radial
        span = wp.float64(model.speeds) * model.speed_cell
        away = away - span * wp.floor(away / span + _HALF)
        sigmas = away / fall
        share = portable_exp(-_HALF * sigmas * sigmas) / (fall * wp.sqrt(_TWO_PI))
        speed_out[slot, cell] = share * model.speed_cell


@wp.func
def variance_of(
    state: RadarSlot,
    near: wp.array2d(dtype=wp.float64),
    by_speed: wp.array2d(dtype=wp.float64),
    slot: wp.int32,
    speed: wp.int32,
    row: wp.int32,
) -> wp.float64:
    """Power of thermal noise and rain in a cell of one antenna, over thermal noise [-]."""
    if state.rain_echo <= _ZERO:
        return _ONE
    return _ONE + near[slot, row] * by_speed[slot, speed]


@wp.func
def power_of_noise(
    model: RadarModel, state: RadarSlot, speed: wp.int32, row: wp.int32
) -> wp.float64:
    """Power of noise in all antennas of a cell without echoes, over that of one, in the mean."""
    antennas = model.columns + model.upper
    uniform = first_uniform(noise_bits(model, state, antennas, speed, row))
    first = wp.int32(0)
    tail = uniform
    if uniform > _HALF:
        first = _ROWS + 1
        tail = _ONE - uniform
    place = (-portable_log(tail) - _LN_2) * _ROWS_PER_NEPER
    at = whole_within(place, 0, _ROWS - 1)
    share = place - wp.float64(at)
    low = wp.float64(model.noise_power[first + at])
    high = wp.float64(model.noise_power[first + at + 1])
    return low + share * (high - low)


@wp.kernel
def power_kernel(
    # model
    model: RadarModel,
    # state in
    slots: wp.array(dtype=RadarSlot),
    near: wp.array2d(dtype=wp.float64),
    by_speed: wp.array2d(dtype=wp.float64),
    touched: wp.array(dtype=wp.uint8),
    signals: wp.array2d(dtype=wp.vec2),
    # out
    power_out: wp.array3d(dtype=wp.float32),
):
    """Mean power of the antennas over thermal noise [S, speeds, ranges]; threads over (slot, block
    of :data:`SPEEDS` speeds, range). Without noise its mean takes its place."""
    slot, block, row = wp.tid()
    state = slots[slot]
    if state.active == 0:
        return
    antennas = model.columns + model.upper
    for speed in range(block * _SPEEDS, wp.min((block + 1) * _SPEEDS, model.speeds)):
        cell = cell_of(model, slot, speed, row)
        there = touched[cell] != wp.uint8(0)
        total = _ZERO
        if state.noise == 0:
            total = wp.float64(antennas)
            if there:
                for a in range(antennas):
                    signal = signals[cell, a]
                    total += wp.float64(wp.dot(signal, signal))
        else:
            variance = variance_of(state, near, by_speed, slot, speed, row)
            if there:
                for a in range(antennas):
                    bits = noise_bits(model, state, a, speed, row)
                    value = signals[cell, a] + noise_of(bits, variance)
                    total += wp.float64(wp.dot(value, value))
            else:
                total = variance * power_of_noise(model, state, speed, row)
        power_out[slot, speed, row] = wp.float32(total / wp.float64(antennas))
