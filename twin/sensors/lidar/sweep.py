"""The sweep: where the sensor was when it fired each column, and which objects can be in its way.

Rays of a LiDAR are grouped in tiles of neighbouring channels and columns. On a GPU a tile is a
warp; the CPU meets a tile in packets (:mod:`twin.sensors.lidar.packet`).
"""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from schemas.sections.lidar import LidarMount, LidarProfile
from twin.base.portable_math import (
    portable_acos,
    portable_asin_f32,
    portable_atan2_f32,
    portable_sin,
)
from twin.render.trace.geometry import ObjectPose, RayScene
from twin.sensors.lidar.air import LidarAir
from twin.sensors.truth import POSITION, rotation_at, vector_at

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TILE = (8, 4)
"""Columns and channels of a tile; 32 rays on a GPU, multiples of 8 and 2 on the CPU."""

MASK_BITS = 32
"""Objects per word of a tile's mask."""
_MASK_BITS = wp.constant(MASK_BITS)

# Slack of the tile test: how far sensor and objects turn and move while a tile is fired.
_SLACK_RAD = wp.constant(0.02)
_SLACK_M = wp.constant(0.5)
_TURN = wp.constant(6.2831853)

_SUB_RAYS = {
    # Offsets in half widths of the beam, and weights: a Gaussian beam that is cut at 1/e^2.
    1: ([(0.0, 0.0)], [1.0]),
    5: ([(0.0, 0.0), (0.6, 0.0), (-0.6, 0.0), (0.0, 0.6), (0.0, -0.6)], [0.36] + [0.16] * 4),
}


@wp.struct
class BeamTable:
    """Constant directions of one profile."""

    channels: wp.int32
    columns: wp.int32
    sub_rays: wp.int32
    tile_columns: wp.int32
    tile_rows: wp.int32
    """Channels of a tile."""
    range_max: wp.float32
    """[m]"""
    range_min: wp.float32
    """[m]"""
    azimuth: wp.array(dtype=wp.vec2)
    """Per column: cos and sin of theta."""
    theta: wp.array(dtype=wp.float32)
    """Per column: theta [rad]."""
    elevation: wp.array(dtype=wp.vec2)
    """Per channel: cos and sin of phi (down)."""
    time: wp.array(dtype=wp.float32)
    """Per column: relative to the tick, <= 0 [s]."""
    share: wp.array(dtype=wp.float64)
    """Per column: place between the poses one sweep ago (0) and now (1)."""
    offset: wp.array(dtype=wp.vec2)
    """Per sub-ray: to the left and up [rad]."""
    weight: wp.array(dtype=wp.float32)
    """Per sub-ray: share of the pulse's energy; they add up to 1."""


@wp.struct
class SweepPose:
    """The sensor when it fires one column."""

    origin: wp.vec3
    """World [m]."""
    rotation: wp.mat33
    """world_from_sensor."""
    time: wp.float32
    """Of objects, relative to the tick [s]; 0 without motion."""


@wp.struct
class BeamHit:
    """What one sub-ray meets first."""

    t: wp.float32
    """Distance [m]; ``range_max`` without a hit."""
    cosine: wp.float32
    """Of the angle of incidence, 0..1."""
    face: wp.int32
    """Row of the table of faces; -1: nothing."""
    owner: wp.int32
    """2 (column of the slot's object poses + 1) + (1 if the face looks up); object -1: static."""


@wp.func
def direction_of(beams: BeamTable, channel: wp.int32, column: wp.int32, sub: wp.int32) -> wp.vec3:
    """Unit direction in sensor axes: [cos theta cos phi, sin theta cos phi, -sin phi]."""
    azimuth = beams.azimuth[column]
    elevation = beams.elevation[channel]
    axis = wp.vec3(azimuth[0] * elevation[0], azimuth[1] * elevation[0], -elevation[1])
    if sub == 0:
        return axis
    left = wp.vec3(-azimuth[1], azimuth[0], 0.0)
    up = wp.vec3(azimuth[0] * elevation[1], azimuth[1] * elevation[1], elevation[0])
    offset = beams.offset[sub]
    return wp.normalize(axis + left * offset[0] + up * offset[1])


def make_beams(
    profile: LidarProfile, hz: int, device: wp.Device, tile: tuple[int, int] = TILE
) -> BeamTable:
    """Tables of ``profile`` at ``hz`` sweeps per second; the last column is fired at the tick."""
    theta, phi = np.radians(profile.thetas_deg), np.radians(profile.phis_deg)
    columns = len(theta)
    share = np.arange(1, columns + 1) / columns
    offsets, weights = _SUB_RAYS[profile.sub_rays]
    half = 0.5e-3 * np.array(profile.divergence_mrad)
    beams = BeamTable()
    beams.channels, beams.columns, beams.sub_rays = len(phi), columns, profile.sub_rays
    beams.tile_columns, beams.tile_rows = tile
    beams.range_max, beams.range_min = profile.range_max_m, profile.range_min_m

    def table(values: np.ndarray, dtype: type) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)

    beams.azimuth = table(np.stack([np.cos(theta), np.sin(theta)], 1), wp.vec2)
    beams.theta = table(theta, wp.float32)
    beams.elevation = table(np.stack([np.cos(phi), np.sin(phi)], 1), wp.vec2)
    beams.time = table((share - 1.0) / hz, wp.float32)
    beams.share = table(share, wp.float64)
    beams.offset = table(np.array(offsets) * half, wp.vec2)
    beams.weight = table(np.array(weights), wp.float32)
    return beams


def mount_rotation(mount: LidarMount) -> wp.quatd:
    """vehicle_from_sensor: yaw about z, then pitch about y, then roll about x."""
    roll, pitch, yaw = (0.5 * math.radians(angle) for angle in mount.rotation_deg)
    about_z = wp.quatd(0.0, 0.0, math.sin(yaw), math.cos(yaw))
    about_y = wp.quatd(0.0, math.sin(pitch), 0.0, math.cos(pitch))
    about_x = wp.quatd(math.sin(roll), 0.0, 0.0, math.cos(roll))
    return about_z * about_y * about_x


@wp.func
def _between(a: wp.quatd, b: wp.quatd, share: wp.float64) -> wp.quatd:
    """Spherical linear interpolation from ``a`` (share 0) to ``b`` (share 1)."""
    one = wp.float64(1.0)
    cosine = wp.dot(a, b)
    to = b
    if cosine < wp.float64(0.0):
        to = -b
        cosine = -cosine
    if cosine > wp.float64(0.99999999):
        return wp.normalize(a * (one - share) + to * share)
    angle = portable_acos(wp.min(cosine, one))
    scale = one / portable_sin(angle)
    low = portable_sin((one - share) * angle) * scale
    return wp.normalize(a * low + to * (portable_sin(share * angle) * scale))


@wp.kernel
def sweep_kernel(
    # model
    beams: BeamTable,
    mount: wp.vec3d,
    mount_turn: wp.quatd,
    # state in
    air: wp.array(dtype=LidarAir),
    truth: wp.array2d(dtype=wp.float64),
    before: wp.array2d(dtype=wp.float64),
    # out
    poses_out: wp.array2d(dtype=SweepPose),
):
    """Sensor pose of every column [S, columns] from the vehicle's truth now and one sweep ago."""
    slot, column = wp.tid()
    own = air[slot]
    if own.active == 0:
        return
    position = vector_at(truth, slot, POSITION)
    turn = rotation_at(truth, slot)
    pose = SweepPose()
    # Nothing is known of the time before the first sweep: it is taken at the tick.
    if own.motion != 0 and own.fresh == 0:
        pose.time = beams.time[column]
        if column < beams.columns - 1:
            share = beams.share[column]
            was = vector_at(before, slot, POSITION)
            position = was + (position - was) * share
            turn = _between(rotation_at(before, slot), turn, share)
    origin = position + wp.quat_rotate(turn, mount)
    sensor = turn * mount_turn
    rotation = wp.quat_to_matrix(sensor)
    pose.origin = wp.vec3(wp.float32(origin[0]), wp.float32(origin[1]), wp.float32(origin[2]))
    for i in range(3):
        for j in range(3):
            pose.rotation[i, j] = wp.float32(rotation[i, j])
    poses_out[slot, column] = pose


@wp.kernel
def remember_kernel(
    # state in
    air: wp.array(dtype=LidarAir),
    truth: wp.array2d(dtype=wp.float64),
    # out
    before_out: wp.array2d(dtype=wp.float64),
):
    """Position and rotation of this tick, for the next sweep."""
    slot = wp.tid()
    if air[slot].active == 0:
        return
    for column in range(before_out.shape[1]):
        before_out[slot, column] = truth[slot, column]


@wp.func
def _in_wedge(
    beams: BeamTable, pose: SweepPose, first: wp.int32, last: wp.int32, thing: ObjectPose
):
    """Whether rays of the columns ``first`` to ``last`` can meet the object's sphere.

    Whatever their phi, these rays stay in a wedge about the sensor's z axis.
    """
    centre = thing.centre + thing.velocity * pose.time
    local = (centre - pose.origin) @ pose.rotation  # sensor_from_world: the transpose
    radius = thing.radius + _SLACK_M
    if wp.length(local) - radius > beams.range_max:
        return False
    flat = wp.sqrt(local[0] * local[0] + local[1] * local[1])
    if flat <= radius:
        return True
    half = portable_asin_f32(radius / flat)
    half += 0.5 * (beams.theta[last] - beams.theta[first]) + _SLACK_RAD
    middle = 0.5 * (beams.theta[last] + beams.theta[first])
    off = portable_atan2_f32(local[1], local[0]) - middle
    off = off - _TURN * wp.floor(off / _TURN + 0.5)
    return wp.abs(off) <= half


@wp.kernel
def mask_kernel(
    # model
    beams: BeamTable,
    scene: RayScene,
    # state in
    air: wp.array(dtype=LidarAir),
    poses: wp.array2d(dtype=SweepPose),
    # out
    mask_out: wp.array3d(dtype=wp.uint32),
):
    """Objects that a tile's columns can meet: bits of mask [S, tiles along theta, words]."""
    slot, tile, word = wp.tid()
    if air[slot].active == 0:
        return
    first = tile * beams.tile_columns
    last = wp.min(first + beams.tile_columns, beams.columns) - 1
    pose = poses[slot, (first + last) / 2]
    bits = wp.uint32(0)
    for bit in range(_MASK_BITS):
        m = word * _MASK_BITS + bit
        if m < scene.objects.shape[1]:
            thing = scene.objects[slot, m]
            if thing.root != 0 and _in_wedge(beams, pose, first, last, thing):
                bits = bits | (wp.uint32(1) << wp.uint32(bit))
    mask_out[slot, tile, word] = bits
