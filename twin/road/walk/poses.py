"""Warp functions: poses in the world from places of a road.

The equations are those of ``twin.road.opendrive.road_frame``, section by section; level lanes
count, heights of lanes do not. On the flat ground, road -1, x is s and y is t.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_atan2, portable_cos, portable_sin
from twin.road.walk.lanes import border_at, section_row
from twin.road.walk.road_arrays import RoadArrays
from twin.road.walk.spots import (
    ONE,
    ZERO,
    elevation_at,
    line_row,
    line_spot,
    road_length,
    tilt_at,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_SLOPE_MIN = wp.constant(wp.float64(1e-6))


@wp.struct
class RoadPoint:
    """A pose in the world, and what the road does there."""

    x: wp.float64
    y: wp.float64
    z: wp.float64
    heading: wp.float64
    """In [-pi, pi] [rad]."""
    pitch: wp.float64
    """Down is positive [rad]."""
    roll: wp.float64
    """To the right is positive [rad]."""
    curvature: wp.float64
    """Of the reference line, to the left positive [1/m]."""
    climb: wp.float64
    """Slope of the surface along the heading [m/m]."""


@wp.struct
class AcrossSpot:
    """A place of a cross section, and how it changes with s and t."""

    side: wp.float64
    up: wp.float64
    side_s: wp.float64
    up_s: wp.float64
    side_t: wp.float64
    up_t: wp.float64


@wp.func
def tilted_across(
    t: wp.float64, cosine: wp.float64, sine: wp.float64, rate: wp.float64
) -> AcrossSpot:
    """A place of a tilted cross section; ``rate`` of the tilt [rad/m]."""
    across = AcrossSpot()
    across.side = t * cosine
    across.up = t * sine
    across.side_s = -(t * sine * rate)
    across.up_s = t * cosine * rate
    across.side_t = cosine
    across.up_t = sine
    return across


@wp.func
def level_edge(roads: RoadArrays, road: wp.int32, s: wp.float64, t: wp.float64) -> wp.vec3d:
    """Where the level part of a cross section begins on the side of t: t, slope, and 1 if t lies on
    it."""
    section = section_row(roads, road, s)
    left, right = roads.sections[section, 2], roads.sections[section, 3]
    if left > 0:
        edge = border_at(roads, road, section, left - 1, s)
        if t > edge[0]:
            return wp.vec3d(edge[0], edge[1], ONE)
    if right < 0:
        edge = border_at(roads, road, section, right + 1, s)
        if t < edge[0]:
            return wp.vec3d(edge[0], edge[1], ONE)
    return wp.vec3d(ZERO, ZERO, ZERO)


@wp.func
def surface_across(roads: RoadArrays, road: wp.int32, s: wp.float64, t: wp.float64) -> AcrossSpot:
    """A place of the surface in its cross section."""
    tilt = tilt_at(roads, road, s)
    cosine, sine = portable_cos(tilt[0]), portable_sin(tilt[0])
    edge = level_edge(roads, road, s, t)
    if edge[2] == ZERO:
        return tilted_across(t, cosine, sine, tilt[1])
    across = tilted_across(edge[0], cosine, sine, tilt[1])
    across.side += t - edge[0]
    across.side_s += edge[1] * (across.side_t - ONE)
    across.up_s += edge[1] * across.up_t
    across.side_t = ONE
    across.up_t = ZERO
    return across


@wp.func
def pose_along(
    roads: RoadArrays,
    road: wp.int32,
    s: wp.float64,
    t: wp.float64,
    slope: wp.float64,
    follow: wp.bool,
) -> RoadPoint:
    """The pose at s, t, headed along the way of that slope dt/ds if ``follow``, else along the
    reference line."""
    point = RoadPoint()
    if road < 0:
        point.x = s
        point.y = t
        return point
    at = wp.clamp(s, ZERO, road_length(roads, road))
    spot = line_spot(roads, line_row(roads, road, at), at)
    across = surface_across(roads, road, at, t)
    height = elevation_at(roads, road, at)
    point.x = spot.x - across.side * spot.sine
    point.y = spot.y + across.side * spot.cosine
    point.z = height[0] + across.up
    point.curvature = spot.curvature
    # The plane that the ways along s and along t span, as slopes along and across the road.
    forward = ONE - spot.curvature * across.side
    if wp.abs(forward) < _SLOPE_MIN:
        forward = _SLOPE_MIN
    to_left = across.up_t / across.side_t
    ahead = (height[1] + across.up_s - to_left * across.side_s) / forward
    drift = ZERO
    if follow:
        drift = across.side_s + slope * across.side_t
    step = wp.max(forward, _SLOPE_MIN)
    length = wp.sqrt(step * step + drift * drift)
    bend_cosine, bend_sine = step / length, drift / length
    point.climb = ahead * bend_cosine + to_left * bend_sine
    cross = to_left * bend_cosine - ahead * bend_sine
    point.pitch = -portable_atan2(point.climb, ONE)
    point.roll = portable_atan2(cross / wp.sqrt(ONE + point.climb * point.climb), ONE)
    point.heading = portable_atan2(
        spot.sine * bend_cosine + spot.cosine * bend_sine,
        spot.cosine * bend_cosine - spot.sine * bend_sine,
    )
    return point


@wp.func
def road_pose(roads: RoadArrays, road: wp.int32, s: wp.float64, t: wp.float64) -> RoadPoint:
    """The pose at s, t, headed along s; stations beyond the ends count as the ends."""
    return pose_along(roads, road, s, t, ZERO, False)
