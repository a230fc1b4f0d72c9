"""Rays of a camera, where they begin and point: one table for all slots, one pose per slot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from twin.base.portable_math import portable_cos, portable_sin
from twin.vehicle.state import COLUMN

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_X, _Y, _Z, _Q = (wp.constant(COLUMN[name]) for name in ("x_m", "y_m", "z_m", "orientation_x"))


@wp.struct
class Optics:
    """The camera on its vehicle; vehicle axes x forward of the rear axle, y left, z up."""

    width: wp.int32
    """[px]"""
    height: wp.int32
    """[px]"""
    near: wp.float32
    """Nothing nearer along the camera's axis is seen [m]."""
    far: wp.float32
    """Nor anything farther [m]."""
    spherical: wp.int32
    """1: near and far are distances from the camera, not along its axis."""
    pixel: wp.float32
    """Angle between neighbouring rays in the middle of the picture [rad]."""
    mount: wp.vec3
    """Position in the vehicle [m]."""
    right: wp.vec3
    """Axes of the camera in the vehicle."""
    down: wp.vec3
    ahead: wp.vec3
    lamps: wp.vec3
    """Middle of the headlamps, in the vehicle [m]."""


@wp.struct
class SlotPose:
    """Camera and vehicle of a slot in the world."""

    eye: wp.vec3
    """[m]"""
    right: wp.vec3
    down: wp.vec3
    ahead: wp.vec3
    position: wp.vec3
    """Reference point of the vehicle: middle of the rear axle, on the ground [m]."""
    forward: wp.vec3
    left: wp.vec3
    up: wp.vec3


def mount(optics: Optics, position_m: Sequence[float], vehicle_from_camera: np.ndarray) -> None:
    """Write where the camera is; columns of the rotation [3, 3]: its right, down and forward."""
    optics.mount = wp.vec3(*position_m)
    optics.right, optics.down, optics.ahead = (wp.vec3(*c) for c in vehicle_from_camera.T.tolist())


@wp.func
def _slot_pose(
    position: wp.vec3, forward: wp.vec3, left: wp.vec3, up: wp.vec3, optics: Optics
) -> SlotPose:
    pose = SlotPose()
    pose.position = position
    pose.forward = forward
    pose.left = left
    pose.up = up
    pose.eye = position + forward * optics.mount[0] + left * optics.mount[1] + up * optics.mount[2]
    pose.right = forward * optics.right[0] + left * optics.right[1] + up * optics.right[2]
    pose.down = forward * optics.down[0] + left * optics.down[1] + up * optics.down[2]
    pose.ahead = forward * optics.ahead[0] + left * optics.ahead[1] + up * optics.ahead[2]
    return pose


@wp.kernel
def flat_pose_kernel(
    # model
    optics: Optics,
    # state in
    pose_m: wp.array2d(dtype=wp.float64),
    # out
    pose_out: wp.array(dtype=SlotPose),
):
    """Poses [S, 3] of level vehicles on the plane z = 0: x, y [m], yaw [rad]."""
    slot = wp.tid()
    c = wp.float32(portable_cos(pose_m[slot, 2]))
    s = wp.float32(portable_sin(pose_m[slot, 2]))
    position = wp.vec3(wp.float32(pose_m[slot, 0]), wp.float32(pose_m[slot, 1]), 0.0)
    pose_out[slot] = _slot_pose(
        position, wp.vec3(c, s, 0.0), wp.vec3(-s, c, 0.0), wp.vec3(0.0, 0.0, 1.0), optics
    )


@wp.kernel
def pose_kernel(
    # model
    optics: Optics,
    # state in
    state: wp.array2d(dtype=wp.float64),
    # out
    pose_out: wp.array(dtype=SlotPose),
):
    """Vehicle states [S, T], columns :data:`twin.vehicle.state.COLUMN`: the body's attitude too."""
    slot = wp.tid()
    x = state[slot, _Q]
    y = state[slot, _Q + 1]
    z = state[slot, _Q + 2]
    w = state[slot, _Q + 3]
    one = wp.float64(1.0)
    two = wp.float64(2.0)
    forward = wp.vec3(
        wp.float32(one - two * (y * y + z * z)),
        wp.float32(two * (x * y + w * z)),
        wp.float32(two * (x * z - w * y)),
    )
    left = wp.vec3(
        wp.float32(two * (x * y - w * z)),
        wp.float32(one - two * (x * x + z * z)),
        wp.float32(two * (y * z + w * x)),
    )
    up = wp.cross(forward, left)
    position = wp.vec3(
        wp.float32(state[slot, _X]), wp.float32(state[slot, _Y]), wp.float32(state[slot, _Z])
    )
    pose_out[slot] = _slot_pose(position, forward, left, up, optics)
