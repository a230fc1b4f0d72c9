"""Peaks of the range-Doppler map that stand above a constant false-alarm rate.

That a cell exceeds a times the k-th smallest of its references says that at least k of them lie
below its a-th part: they are counted, not sorted.
"""

from __future__ import annotations

import warp as wp

from twin.sensors.radar.echo import RadarModel, RadarSlot
from twin.sensors.radar.spectrum import SPEEDS
from twin.sensors.radar.threshold import GUARD, RANK, REFERENCES

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

PEAKS_MAX = 512
"""Most peaks of a slot; of more those are lost that are farthest away."""

_PEAKS_MAX = wp.constant(PEAKS_MAX)
_GUARD, _RANK, _QUARTER = (wp.constant(n) for n in (GUARD, RANK, REFERENCES // 4))
_SPEEDS = wp.constant(SPEEDS)
_SIXTEEN = wp.constant(REFERENCES // 2)

References = wp.types.vector(length=REFERENCES, dtype=wp.float32)


@wp.func
def reference(
    power: wp.array3d(dtype=wp.float32),
    slot: wp.int32,
    speed: wp.int32,
    row: wp.int32,
    number: wp.int32,
) -> wp.float32:
    """Reference cell ``number`` of a cell: first those in range, then those in speed.

    Beyond an end of the ranges come further cells of the other side; speeds are a circle.
    """
    side = number % 2
    along = (number % _SIXTEEN) / 2
    off = _GUARD + 1 + along
    if side == 1:
        off = -off
    if number < _SIXTEEN:
        ranges = power.shape[2]
        place = row + off
        if place < 0:
            place = row + _GUARD + 1 + _QUARTER + along
        if place >= ranges:
            place = row - _GUARD - 1 - _QUARTER - along
        return power[slot, speed, place]
    speeds = power.shape[1]
    return power[slot, (speed + off + speeds) % speeds, row]


@wp.func
def exceeds(
    power: wp.array3d(dtype=wp.float32),
    slot: wp.int32,
    speed: wp.int32,
    row: wp.int32,
    factor: wp.float32,
) -> wp.bool:
    """Whether a cell is above ``factor`` times the level of its references."""
    limit = power[slot, speed, row] / factor
    above = wp.int32(0)
    for number in range(2 * _SIXTEEN):
        if reference(power, slot, speed, row, number) >= limit:
            above += 1
            if above > 2 * _SIXTEEN - _RANK:
                return False
    return True


@wp.func
def level_of(
    power: wp.array3d(dtype=wp.float32), slot: wp.int32, speed: wp.int32, row: wp.int32
) -> wp.float32:
    """The k-th smallest reference of a cell."""
    values = References()
    for number in range(2 * _SIXTEEN):
        values[number] = reference(power, slot, speed, row, number)
    level = wp.float32(0.0)
    for number in range(2 * _SIXTEEN):
        value = values[number]
        smaller = wp.int32(0)
        for other in range(2 * _SIXTEEN):
            against = values[other]
            if against < value or (against == value and other < number):
                smaller += 1
        if smaller == _RANK - 1:
            level = value
    return level


@wp.func
def _highest(
    power: wp.array3d(dtype=wp.float32), slot: wp.int32, speed: wp.int32, row: wp.int32
) -> wp.bool:
    """Whether no neighbour is higher; of equal ones the first counts."""
    here = power[slot, speed, row]
    speeds = power.shape[1]
    for place in range(9):
        if place != 4:
            other = (speed + place % 3 - 1 + speeds) % speeds
            value = power[slot, other, row + place / 3 - 1]
            if value > here or (value == here and place < 4):
                return False
    return True


@wp.kernel
def alarm_kernel(
    # model
    model: RadarModel,
    peaks_only: wp.int32,
    # state in
    slots: wp.array(dtype=RadarSlot),
    power: wp.array3d(dtype=wp.float32),
    # out
    alarm_out: wp.array3d(dtype=wp.uint8),
):
    """1 where a cell is above its threshold [S, speeds, ranges]; ``peaks_only``: and no neighbour
    is higher. Threads over (slot, block of speeds, range)."""
    slot, block, row = wp.tid()
    if slots[slot].active == 0:
        return
    for speed in range(block * _SPEEDS, wp.min((block + 1) * _SPEEDS, model.speeds)):
        alarm = wp.uint8(0)
        looked_at = row >= model.first_row and row <= model.last_row
        if looked_at and peaks_only != 0:
            looked_at = _highest(power, slot, speed, row)
        if looked_at and exceeds(power, slot, speed, row, model.factor):
            alarm = wp.uint8(1)
        alarm_out[slot, speed, row] = alarm


@wp.kernel
def count_kernel(
    # model
    model: RadarModel,
    # state in
    slots: wp.array(dtype=RadarSlot),
    alarm: wp.array3d(dtype=wp.uint8),
    # out
    count_out: wp.array2d(dtype=wp.int32),
):
    """Alarms of each range cell [S, ranges]."""
    slot, row = wp.tid()
    if slots[slot].active == 0:
        return
    count = wp.int32(0)
    for speed in range(model.speeds):
        count += wp.int32(alarm[slot, speed, row])
    count_out[slot, row] = count


@wp.kernel
def offset_kernel(
    # model
    model: RadarModel,
    # state in
    slots: wp.array(dtype=RadarSlot),
    # state in and out
    count: wp.array2d(dtype=wp.int32),
    # out
    total_out: wp.array(dtype=wp.int32),
):
    """Number of the first peak of each range cell, in place of its count; and of all peaks [S]."""
    slot = wp.tid()
    total = wp.int32(0)
    if slots[slot].active != 0:
        for row in range(model.ranges):
            here = count[slot, row]
            count[slot, row] = total
            total += here
    total_out[slot] = wp.min(total, _PEAKS_MAX)


@wp.kernel
def list_kernel(
    # model
    model: RadarModel,
    # state in
    slots: wp.array(dtype=RadarSlot),
    alarm: wp.array3d(dtype=wp.uint8),
    first: wp.array2d(dtype=wp.int32),
    # out
    peaks_out: wp.array2d(dtype=wp.int32),
):
    """Cells of the peaks, speed + speeds x range [S, PEAKS_MAX], by range, then speed."""
    slot, row = wp.tid()
    if slots[slot].active == 0:
        return
    number = first[slot, row]
    for speed in range(model.speeds):
        if alarm[slot, speed, row] != wp.uint8(0):
            if number < _PEAKS_MAX:
                peaks_out[slot, number] = row * model.speeds + speed
            number += 1
