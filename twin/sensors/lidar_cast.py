"""Which face each ray of a LiDAR meets first: one thread per ray, for GPUs.

:mod:`twin.sensors.lidar_packet` is the same for the CPU.
"""

from __future__ import annotations

import warp as wp

from twin.render.geometry import Scene
from twin.sensors.lidar_air import LidarAir
from twin.sensors.lidar_sweep import (
    MASK_BITS,
    TILE_COLUMNS,
    TILE_ROWS,
    Beams,
    Hit,
    SweepPose,
    direction_of,
)

wp.set_module_options({"enable_backward": False})

_TILE_COLUMNS = wp.constant(TILE_COLUMNS)
_TILE_ROWS = wp.constant(TILE_ROWS)
_TILE = wp.constant(TILE_COLUMNS * TILE_ROWS)
_MASK_BITS = wp.constant(MASK_BITS)
_UP = wp.constant(0.5)


@wp.func
def _spun(v: wp.vec3, c: wp.float32, s: wp.float32) -> wp.vec3:
    return wp.vec3(c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])


@wp.func
def _against_object(
    scene: Scene,
    slot: wp.int32,
    m: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    time: wp.float32,
    best: Hit,
) -> Hit:
    """``best``, or the hit of the object ``m`` where it was ``time`` [s] from the tick."""
    radius = scene.objects[slot, m].radius
    velocity = scene.objects[slot, m].velocity
    to = scene.objects[slot, m].centre + velocity * time - origin
    along = wp.dot(to, direction)
    inside = radius * radius + along * along - wp.dot(to, to)
    # The sphere's centre is not turned back with the object; it reaches farther by that little.
    if inside < -0.5 * radius * radius or along + 1.5 * radius < 0.0:
        return best
    if along - 1.5 * radius > best.t:
        return best
    pose = scene.objects[slot, m]
    angle = pose.yaw_rate * time
    c = wp.cos(angle)
    s = wp.sin(angle)
    cosine = pose.cosine * c - pose.sine * s
    sine = pose.sine * c + pose.cosine * s
    local = _spun(origin - (pose.position + velocity * time), cosine, -sine)
    ahead = _spun(direction, cosine, -sine)
    own = wp.mesh_query_ray(pose.mesh, local, ahead, best.t)
    if own.result:
        best.t = own.t
        best.face = pose.first_face + own.face
        best.cosine = wp.abs(wp.dot(own.normal, ahead))
        best.owner = 2 * (m + 1) + wp.where(wp.abs(own.normal[2]) > _UP, 1, 0)
    return best


@wp.kernel
def cast_kernel(
    # model
    scene: Scene,
    beams: Beams,
    # state in
    air: wp.array(dtype=LidarAir),
    poses: wp.array2d(dtype=SweepPose),
    mask: wp.array3d(dtype=wp.uint32),
    # out
    hits_out: wp.array2d(dtype=Hit),
):
    """First hits [S, channels x columns x sub-rays]; threads over (slot, sub-ray, tile, ray)."""
    thread = wp.tid()
    inside = thread % _TILE
    tile = thread / _TILE
    tiles_y = (beams.channels + _TILE_ROWS - 1) / _TILE_ROWS
    tiles_x = (beams.columns + _TILE_COLUMNS - 1) / _TILE_COLUMNS
    group = tile / (tiles_x * tiles_y)
    tile = tile - group * tiles_x * tiles_y
    slot = group / beams.sub_rays
    sub = group - slot * beams.sub_rays
    tile_x = tile / tiles_y
    channel = (tile - tile_x * tiles_y) * _TILE_ROWS + inside / _TILE_COLUMNS
    column = tile_x * _TILE_COLUMNS + inside % _TILE_COLUMNS
    if channel >= beams.channels or column >= beams.columns or air[slot].active == 0:
        return
    pose = poses[slot, column]
    direction = pose.rotation * direction_of(beams, channel, column, sub)
    hit = Hit()
    hit.t = beams.range_max
    hit.face = wp.int32(-1)
    static = wp.mesh_query_ray(scene.mesh, pose.origin, direction, beams.range_max)
    if static.result:
        hit.t = static.t
        hit.face = static.face
        hit.cosine = wp.abs(wp.dot(static.normal, direction))
        hit.owner = wp.where(wp.abs(static.normal[2]) > _UP, 1, 0)
    for word in range(mask.shape[2]):
        bits = mask[slot, tile_x, word]
        m = word * _MASK_BITS
        while bits != wp.uint32(0):
            if (bits & wp.uint32(1)) != wp.uint32(0):
                hit = _against_object(scene, slot, m, pose.origin, direction, pose.time, hit)
            bits = bits >> wp.uint32(1)
            m += 1
    row = (channel * beams.columns + column) * beams.sub_rays + sub
    hits_out[slot, row] = hit
