"""Which face each ray of a LiDAR meets first: one thread per ray, for GPUs.

:mod:`twin.sensors.lidar.packet` is the same for the CPU, to the last bit.
"""

from __future__ import annotations

from functools import cache

import warp as wp

from twin.render.build import Features
from twin.render.trace.geometry import ObjectPose, RayScene, into_object
from twin.sensors.lidar.air import LidarAir
from twin.sensors.lidar.packet import PACKET
from twin.sensors.lidar.ray import nearest, nearest_there
from twin.sensors.lidar.sweep import (
    MASK_BITS,
    BeamHit,
    BeamTable,
    SweepPose,
    direction_of,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_MASK_BITS = wp.constant(MASK_BITS)
_PACKET_COLUMNS = wp.constant(PACKET[0])


@wp.struct
class _Best:
    """The nearest face so far."""

    t: wp.float32
    face: wp.int32
    object: wp.int32
    slant: wp.float32
    """Part of a normal of the face along the ray."""
    square: wp.float32
    """Of the length of that normal; negative where it looks rather up than aside."""


@wp.func
def back_in_time(thing: ObjectPose, time: wp.float32) -> ObjectPose:
    """An object where it was ``time`` [s] from the tick: its yaw then, by the first terms of sine
    and cosine."""
    pose = thing
    angle = thing.yaw_rate * time
    square = angle * angle
    c = 1.0 - square * (0.5 - square * 0.041666668)
    s = angle * (1.0 - square * (0.16666667 - square * 0.008333334))
    pose.cosine = thing.cosine * c - thing.sine * s
    pose.sine = thing.sine * c + thing.cosine * s
    pose.position = thing.position + thing.velocity * time
    return pose


BLOCK = 128
"""Threads of a block at most; eight blocks fit a multiprocessor of 64 k registers."""


@cache
def cast_kernel_of(features: Features) -> wp.Kernel:
    """The kernel for worlds with such ``features``."""
    holes = features.holes

    @wp.func
    def against_object(
        scene: RayScene,
        slot: wp.int32,
        m: wp.int32,
        head: SweepPose,
        origin: wp.vec3,
        direction: wp.vec3,
        time: wp.float32,
        best: _Best,
    ) -> _Best:
        """``best``, or what is hit of the object ``m`` where it was ``time`` [s] from the tick."""
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
        pose = back_in_time(scene.objects[slot, m], time)
        local = into_object(origin - pose.position, pose)
        ahead = into_object(direction, pose)
        first = back_in_time(scene.objects[slot, m], head.time)
        local_head = into_object(head.origin - first.position, first)
        if wp.static(holes):
            own = nearest_there(
                scene.nodes,
                scene.leaves,
                scene.uv,
                scene.cuts,
                pose.root,
                pose.first_face,
                local_head,
                local,
                ahead,
                best.t,
            )
        else:
            own = nearest(scene.nodes, scene.leaves, pose.root, local_head, local, ahead, best.t)
        face = wp.cast(own[3], wp.int32)
        if face >= 0:
            best.t = own[0]
            best.face = pose.first_face + face
            best.slant = own[1]
            best.square = own[2]
            best.object = m
        return best

    @wp.kernel(
        module="unique",
        enable_backward=False,
        grid_stride=False,
        launch_bounds=(BLOCK, 8),
        module_options={"fuse_fp": False},
    )
    def cast_kernel(
        # model
        scene: RayScene,
        beams: BeamTable,
        # state in
        air: wp.array(dtype=LidarAir),
        poses: wp.array2d(dtype=SweepPose),
        mask: wp.array3d(dtype=wp.uint32),
        # out
        hits_out: wp.array2d(dtype=BeamHit),
    ):
        """First hits [S, channels x columns x sub-rays]; threads over (slot, sub-ray, tile,
        ray)."""
        thread = wp.tid()
        rays = beams.tile_columns * beams.tile_rows
        tile = thread / rays
        inside = thread - tile * rays
        tiles_y = (beams.channels + beams.tile_rows - 1) / beams.tile_rows
        tiles_x = (beams.columns + beams.tile_columns - 1) / beams.tile_columns
        group = tile / (tiles_x * tiles_y)
        tile = tile - group * tiles_x * tiles_y
        slot = group / beams.sub_rays
        sub = group - slot * beams.sub_rays
        tile_x = tile / tiles_y
        row = inside / beams.tile_columns
        channel = (tile - tile_x * tiles_y) * beams.tile_rows + row
        column = tile_x * beams.tile_columns + inside - row * beams.tile_columns
        if channel >= beams.channels or column >= beams.columns or air[slot].active == 0:
            return
        pose = poses[slot, column]
        # The first ray of the packet that a CPU would cast this one with.
        head = poses[slot, column - column % _PACKET_COLUMNS]
        direction = pose.rotation * direction_of(beams, channel, column, sub)
        best = _Best()
        best.object = wp.int32(-1)
        if wp.static(holes):
            static = nearest_there(
                scene.nodes,
                scene.leaves,
                scene.uv,
                scene.cuts,
                0,
                0,
                head.origin,
                pose.origin,
                direction,
                beams.range_max,
            )
        else:
            static = nearest(
                scene.nodes, scene.leaves, 0, head.origin, pose.origin, direction, beams.range_max
            )
        best.t = static[0]
        best.face = wp.cast(static[3], wp.int32)
        best.slant = static[1]
        best.square = static[2]
        for word in range(mask.shape[2]):
            bits = mask[slot, tile_x, word]
            m = word * _MASK_BITS
            while bits != wp.uint32(0):
                if (bits & wp.uint32(1)) != wp.uint32(0):
                    best = against_object(
                        scene, slot, m, head, pose.origin, direction, pose.time, best
                    )
                bits = bits >> wp.uint32(1)
                m += 1
        hit = BeamHit()
        hit.t = best.t
        hit.face = best.face
        if best.face >= 0:
            hit.cosine = wp.abs(best.slant) / wp.sqrt(wp.abs(best.square))
            hit.owner = 2 * (best.object + 1) + wp.where(best.square < 0.0, 1, 0)
        hits_out[slot, (channel * beams.columns + column) * beams.sub_rays + sub] = hit

    return cast_kernel
