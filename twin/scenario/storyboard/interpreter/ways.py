"""Warp functions: trajectories and who follows them."""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_cos, portable_sin
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.transition import CLOSE, ZERO
from twin.scenario.storyboard.player.columns import ProgramColumn, Real, Whole

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

_START = wp.constant(wp.int32(0))
_LENGTH = wp.constant(wp.int32(1))
_X = wp.constant(wp.int32(2))
_Y = wp.constant(wp.int32(6))
_Z = wp.constant(wp.int32(10))
_HEADING = wp.constant(wp.int32(14))
_TIME = wp.constant(wp.int32(18))
_DURATION = wp.constant(wp.int32(19))


@wp.struct
class WayPoint:
    """A place of a trajectory."""

    x: wp.float64
    y: wp.float64
    z: wp.float64
    heading: wp.float64
    time: wp.float64
    speed: wp.float64
    """By its times, 0 where it has none [m/s]."""


@wp.func
def way_row(
    tables: ProgramArrays, bodies: BodyArrays, slot: wp.int32, program: wp.int32, e: wp.int32
) -> wp.int32:
    """The row of the trajectory that an entity follows."""
    first = tables.programs[program, ProgramColumn.TRAJECTORY]
    return first + bodies.wholes[slot, e, Whole.TRAJECTORY]


@wp.func
def piece_at(tables: ProgramArrays, way: wp.int32, column: wp.int32, value: wp.float64) -> wp.int32:
    """The last piece of a trajectory whose ``column`` is at most ``value``, else its first."""
    low = tables.trajectories[way, 0]
    high = low + tables.trajectories[way, 1] - 1
    while low < high:
        middle = (low + high + 1) // 2
        if tables.pieces[middle, column] <= value:
            low = middle
        else:
            high = middle - 1
    return low


@wp.func
def way_length(tables: ProgramArrays, way: wp.int32) -> wp.float64:
    """Length of a trajectory."""
    last = tables.trajectories[way, 0] + tables.trajectories[way, 1] - 1
    return tables.pieces[last, _START] + tables.pieces[last, _LENGTH]


@wp.func
def way_times(tables: ProgramArrays, way: wp.int32) -> wp.vec2d:
    """When a trajectory begins and ends."""
    first = tables.trajectories[way, 0]
    last = first + tables.trajectories[way, 1] - 1
    return wp.vec2d(
        tables.pieces[first, _TIME], tables.pieces[last, _TIME] + tables.pieces[last, _DURATION]
    )


@wp.func
def cubic_at(tables: ProgramArrays, row: wp.int32, first: wp.int32, d: wp.float64) -> wp.float64:
    """A polynomial of a piece."""
    upper = tables.pieces[row, first + 2] + d * tables.pieces[row, first + 3]
    return tables.pieces[row, first] + d * (tables.pieces[row, first + 1] + d * upper)


@wp.func
def way_point(tables: ProgramArrays, way: wp.int32, s: wp.float64) -> WayPoint:
    """The place at a distance from the beginning."""
    row = piece_at(tables, way, _START, s)
    length = tables.pieces[row, _LENGTH]
    d = wp.clamp(s - tables.pieces[row, _START], ZERO, length)
    point = WayPoint()
    point.x = cubic_at(tables, row, _X, d)
    point.y = cubic_at(tables, row, _Y, d)
    point.z = cubic_at(tables, row, _Z, d)
    point.heading = cubic_at(tables, row, _HEADING, d)
    duration = tables.pieces[row, _DURATION]
    point.time = tables.pieces[row, _TIME]
    if duration > ZERO:
        point.speed = length / duration
    if length > ZERO:
        point.time += duration * d / length
    return point


@wp.func
def way_place(
    tables: ProgramArrays,
    bodies: BodyArrays,
    slot: wp.int32,
    e: wp.int32,
    way: wp.int32,
    s: wp.float64,
) -> WayPoint:
    """The place in the world of the trajectory ``way`` that an entity follows."""
    point = way_point(tables, way, s)
    turn = bodies.reals[slot, e, Real.WAY_HEADING]
    if tables.trajectories[way, 4] != 0:
        cosine, sine = portable_cos(turn), portable_sin(turn)
        ahead, left = wp.float64(point.x), wp.float64(point.y)
        point.x = bodies.reals[slot, e, Real.WAY_X] + cosine * ahead - sine * left
        point.y = bodies.reals[slot, e, Real.WAY_Y] + sine * ahead + cosine * left
        point.z = bodies.reals[slot, e, Real.WAY_Z] + point.z
        point.heading = point.heading + turn
    return point


@wp.func
def way_at_time(tables: ProgramArrays, way: wp.int32, time: wp.float64) -> wp.float64:
    """Distance from the beginning at a time: even speed between times that are given."""
    row = piece_at(tables, way, _TIME, time)
    duration = tables.pieces[row, _DURATION]
    gone = time - tables.pieces[row, _TIME]
    if gone <= ZERO:
        return tables.pieces[row, _START]
    if gone >= duration - CLOSE:
        return tables.pieces[row, _START] + tables.pieces[row, _LENGTH]
    return tables.pieces[row, _START] + tables.pieces[row, _LENGTH] * gone / duration
