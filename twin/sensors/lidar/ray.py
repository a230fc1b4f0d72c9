"""The faces that a ray of a LiDAR meets, by the code of a GPU: one ray per thread.

A LiDAR fires every column from a place of its own. The CPU meets a face with a packet of rays at
once (:mod:`twin.sensors.lidar.packet`): what all of them need of the face is computed from the
origin of the packet's first ray, and what a ray adds from its own offset. A ray of a GPU takes the
same steps from the same origin, so both give the same bits.
"""

from __future__ import annotations

import warp as wp

from twin.render.trace.cutouts import Cutouts
from twin.render.trace.traverse import closest_with

_VOLUMES = """
                const float ax = P.x - head[0], ay = P.y - head[1], az = P.z - head[2];
                const float bx = Q.x - head[0], by = Q.y - head[1], bz = Q.z - head[2];
                const float kx = S.x - head[0], ky = S.y - head[1], kz = S.z - head[2];
                const float ux = kx - ax, uy = ky - ay, uz = kz - az;
                const float vx = ax - bx, vy = ay - by, vz = az - bz;
                const float wx = bx - kx, wy = by - ky, wz = bz - kz;
                const float ex = kx + ax, ey = ky + ay, ez = kz + az;
                const float fx = ax + bx, fy = ay + by, fz = az + bz;
                const float hx = bx + kx, hy = by + ky, hz = bz + kz;
                float U = TWIN_SUM(TWIN_LESS(ey, uz, ez, uy), dx,
                    TWIN_LESS(ez, ux, ex, uz), dy, TWIN_LESS(ex, uy, ey, ux), dz);
                float V = TWIN_SUM(TWIN_LESS(fy, vz, fz, vy), dx,
                    TWIN_LESS(fz, vx, fx, vz), dy, TWIN_LESS(fx, vy, fy, vx), dz);
                float W = TWIN_SUM(TWIN_LESS(hy, wz, hz, wy), dx,
                    TWIN_LESS(hz, wx, hx, wz), dy, TWIN_LESS(hx, wy, hy, wx), dz);
                if (apart) {
                    U -= TWIN_SUM(ux, gx, uy, gy, uz, gz);
                    V -= TWIN_SUM(vx, gx, vy, gy, vz, gz);
                    W -= TWIN_SUM(wx, gx, wy, gy, wz, gz);
                }
"""
_DISTANCE = """
                    const float nx = TWIN_LESS(uy, vz, uz, vy), ny = TWIN_LESS(uz, vx, ux, vz);
                    const float nz = TWIN_LESS(ux, vy, uy, vx);
                    const float slant = TWIN_SUM(nx, dx, ny, dy, nz, dz);
                    const float height = TWIN_SUM(ax, nx, ay, ny, az, nz);
                    const float t = TWIN_DIV(height - TWIN_SUM(nx, qx, ny, qy, nz, qz), slant);
"""
_KEPT = """
                        best_u = slant;
                        best_v = TWIN_SUM(nx, nx, ny, ny, nz, nz);
                        if (nz * nz > 0.25f * best_v) best_v = -best_v;
"""
_OFFSET = """
    const float qx = origin[0] - head[0], qy = origin[1] - head[1], qz = origin[2] - head[2];
    const bool apart = qx != 0.0f || qy != 0.0f || qz != 0.0f;
    const float gx = 2.0f * (direction[1] * qz - direction[2] * qy);
    const float gy = 2.0f * (direction[2] * qx - direction[0] * qz);
    const float gz = 2.0f * (direction[0] * qy - direction[1] * qx);
    const float near = 0.0f;
"""


@wp.func_native(_OFFSET + closest_with(_VOLUMES, _DISTANCE, _KEPT, holes=False))
def nearest(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    root: wp.int32,
    head: wp.vec3,
    origin: wp.vec3,
    direction: wp.vec3,
    far: wp.float32,
) -> wp.vec4:
    """What a ray meets first within ``far``: its distance, the part of a normal of the face along
    the ray, the square of that normal's length, negative where it looks rather up than aside, and
    the bits of the face, -1: nothing. ``head``: the origin of the packet's first ray."""


@wp.func_native(_OFFSET + closest_with(_VOLUMES, _DISTANCE, _KEPT, holes=True))
def nearest_there(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    corners: wp.array(dtype=wp.vec2),
    cuts: Cutouts,
    root: wp.int32,
    first_face: wp.int32,
    head: wp.vec3,
    origin: wp.vec3,
    direction: wp.vec3,
    far: wp.float32,
) -> wp.vec4:
    """What a ray meets first of faces with holes; arguments beside ``head`` as of
    :func:`twin.render.trace.traverse.closest_there`."""
