"""Warp functions: rows by station, places on reference lines, values of profiles."""

from __future__ import annotations

import warp as wp

from twin.road.walk.road_arrays import RoadArrays

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LINE, SECTION, ELEVATION, TILT, OFFSET = (wp.constant(wp.int32(k)) for k in range(5))
"""Columns of ``roads.roads``."""
ZERO = wp.constant(wp.float64(0.0))
ONE = wp.constant(wp.float64(1.0))
TWO = wp.constant(wp.float64(2.0))
THREE = wp.constant(wp.float64(3.0))
HALF = wp.constant(wp.float64(0.5))


@wp.struct
class LineSpot:
    """A place on a reference line."""

    x: wp.float64
    y: wp.float64
    cosine: wp.float64
    """Of the heading."""
    sine: wp.float64
    curvature: wp.float64
    """To the left positive [1/m]."""


@wp.func
def row_at(
    table: wp.array2d(dtype=wp.float64), first: wp.int32, end: wp.int32, value: wp.float64
) -> wp.int32:
    """The last row of ``first`` to ``end`` - 1 that begins (column 0) at ``value`` or before,
    ``first`` if there is none."""
    low = first
    high = end
    while high - low > 1:
        middle = (low + high) // 2
        if table[middle, 0] <= value:
            low = middle
        else:
            high = middle
    return low


@wp.func
def cubic_at(
    table: wp.array2d(dtype=wp.float64), first: wp.int32, end: wp.int32, value: wp.float64
) -> wp.vec2d:
    """Value and slope of the profile that the rows ``first`` to ``end`` - 1 are."""
    row = row_at(table, first, end, value)
    d = value - table[row, 0]
    b, c, e = table[row, 2], table[row, 3], table[row, 4]
    height = table[row, 1] + d * (b + d * (c + d * e))
    return wp.vec2d(height, b + d * (TWO * c + d * THREE * e))


@wp.func
def elevation_at(roads: RoadArrays, road: wp.int32, s: wp.float64) -> wp.vec2d:
    """Elevation of a reference line, and its slope."""
    return cubic_at(roads.profiles, roads.roads[road, ELEVATION], roads.roads[road, TILT], s)


@wp.func
def tilt_at(roads: RoadArrays, road: wp.int32, s: wp.float64) -> wp.vec2d:
    """Superelevation of a road [rad], and its change per metre."""
    return cubic_at(roads.profiles, roads.roads[road, TILT], roads.roads[road, OFFSET], s)


@wp.func
def offset_at(roads: RoadArrays, road: wp.int32, s: wp.float64) -> wp.vec2d:
    """t of the line that lanes are counted from, and its slope."""
    end = roads.roads[road + 1, ELEVATION]
    return cubic_at(roads.profiles, roads.roads[road, OFFSET], end, s)


@wp.func
def line_row(roads: RoadArrays, road: wp.int32, s: wp.float64) -> wp.int32:
    """The row of ``roads.lines`` with a station."""
    return row_at(roads.lines, roads.roads[road, LINE], roads.roads[road + 1, LINE], s)


@wp.func
def line_spot(roads: RoadArrays, row: wp.int32, s: wp.float64) -> LineSpot:
    """The place at a station of the part ``row`` of a reference line."""
    d = s - roads.lines[row, 0]
    x_1, x_2, x_3 = roads.lines[row, 2], roads.lines[row, 3], roads.lines[row, 4]
    y_1, y_2, y_3 = roads.lines[row, 6], roads.lines[row, 7], roads.lines[row, 8]
    spot = LineSpot()
    spot.x = roads.lines[row, 1] + d * (x_1 + d * (x_2 + d * x_3))
    spot.y = roads.lines[row, 5] + d * (y_1 + d * (y_2 + d * y_3))
    dx = x_1 + d * (TWO * x_2 + d * THREE * x_3)
    dy = y_1 + d * (TWO * y_2 + d * THREE * y_3)
    length = wp.sqrt(dx * dx + dy * dy)
    spot.cosine = dx / length
    spot.sine = dy / length
    spot.curvature = roads.lines[row, 9] + d * roads.lines[row, 10]
    return spot


@wp.func
def road_length(roads: RoadArrays, road: wp.int32) -> wp.float64:
    """Length of a road; 0 of the flat ground [m]."""
    if road < 0:
        return ZERO
    return roads.extents[road, 0]


@wp.func
def road_curvature(roads: RoadArrays, road: wp.int32, s: wp.float64) -> wp.float64:
    """Curvature of the reference line, to the left positive [1/m]."""
    if road < 0:
        return ZERO
    row = line_row(roads, road, s)
    return roads.lines[row, 9] + (s - roads.lines[row, 0]) * roads.lines[row, 10]
