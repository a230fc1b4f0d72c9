"""Kernel that tells a player where the egos of all slots are."""

from __future__ import annotations

import warp as wp

from twin.road.walk.road_arrays import RoadArrays
from twin.scenario.storyboard.interpreter.arrays import BodyArrays
from twin.scenario.storyboard.interpreter.ground import (
    found_place,
    keep_place,
    place_of,
    posed_place,
)
from twin.scenario.storyboard.player.columns import Real, Whole

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


@wp.kernel
def impose_egos_kernel(
    # model
    roads: RoadArrays,
    # args
    egos: wp.array(dtype=wp.int32),
    poses: wp.array2d(dtype=wp.float64),
    # state in and out
    bodies: BodyArrays,
):
    """Put entity ``egos`` [S] of each slot, -1: none, at x, y, z, heading, pitch, roll with a
    speed, ``poses`` [S, 7], until the next step is over; one thread per slot."""
    slot = wp.tid()
    e = egos[slot]
    if e < 0:
        return
    place = place_of(bodies, slot, e)
    place.x = poses[slot, 0]
    place.y = poses[slot, 1]
    place.z = poses[slot, 2]
    place.heading = poses[slot, 3]
    place.pitch = poses[slot, 4]
    place.roll = poses[slot, 5]
    place = found_place(roads, place)
    place = posed_place(roads, place, False)
    keep_place(bodies, slot, e, place)
    bodies.reals[slot, e, Real.SPEED] = poses[slot, 6]
    bodies.wholes[slot, e, Whole.IMPOSED] = 1
