"""Baked ambient occlusion: how much of the sky every vertex of a mesh sees.

For a vertex with normal n the share of the cosine-weighted part of the sky before n that nothing
within :data:`FAR_M` hides: A = sum over free directions / sum over all directions, both over
directions about n with density cos / pi that point above the horizon. In the open A is 1 for any
n that sees the sky at all; on the floor beside a long high wall it is 1/2. Faces that look down
see no sky: for them it is the share of all directions that are free.

Always worked out on the CPU, with the same directions for every vertex, and rounded to 1/255, so
that it is the same wherever it is used. It is kept in a file: the next start takes it from there.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import warp as wp

from twin.base.files import write_atomic
from twin.world.kernel_cache import kept_folder, prepare_kernels
from twin.world.meshes import materials
from twin.world.meshes.mesh import Mesh

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

VERSION = 2
"""Raise it when the same mesh gets other values: files of older versions are then ignored."""
FAR_M = 25.0
"""What is farther away hides no sky [m]."""
RINGS, SECTORS = 6, 8
"""Directions about a normal: rings of equal weight times sectors."""
LEAF_SHARE = 0.45
"""Share of skylight that reaches leaves inside a crown [-]."""
_LIFT_M = 0.02
_INWARD_M = 0.05
_SKY_RAYS_MIN = 4


def directions() -> np.ndarray:
    """Unit directions about +z with density cos / pi, one in the middle of each cell [N, 3]."""
    ring, sector = (a.ravel() for a in np.meshgrid(range(RINGS), range(SECTORS), indexing="ij"))
    radius = np.sqrt((ring + 0.5) / RINGS)
    # Odd rings are turned by half a sector.
    angle = 2.0 * np.pi * (sector + 0.25 + 0.5 * (ring % 2)) / SECTORS
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    return np.stack([x, y, np.sqrt(1.0 - radius**2)], axis=1).astype(np.float32)


@wp.func
def _free_share(
    mesh: wp.uint64,
    rays: wp.array(dtype=wp.vec3),
    far: wp.float32,
    sky_rays_min: wp.int32,
    p: wp.vec3,
    n: wp.vec3,
    whole: wp.bool,
) -> wp.int32:
    """Free share at ``p`` before ``n`` in 1/255; -1 where ``n`` sees no sky and not ``whole``."""
    # An orthonormal frame without a branch that could flip (Duff et al. 2017).
    sign = wp.where(n[2] >= 0.0, wp.float32(1.0), wp.float32(-1.0))
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    side = wp.vec3(1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0])
    up = wp.vec3(b, sign + n[1] * n[1] * a, -n[1])
    sky = wp.int32(0)
    for k in range(rays.shape[0]):
        r = rays[k]
        if side[2] * r[0] + up[2] * r[1] + n[2] * r[2] > 0.0:
            sky += 1
    everywhere = sky < sky_rays_min
    if everywhere and not whole:
        return wp.int32(-1)
    count = wp.int32(0)
    free = wp.int32(0)
    for k in range(rays.shape[0]):
        r = rays[k]
        d = side * r[0] + up * r[1] + n * r[2]
        if d[2] > 0.0 or everywhere:
            count += 1
            if not wp.mesh_query_ray_anyhit(mesh, p, d, far):
                free += 1
    return (free * 510 + count) / (2 * count)


@wp.kernel
def ambient_kernel(
    # model
    mesh: wp.uint64,
    rays: wp.array(dtype=wp.vec3),
    far: wp.float32,
    sky_rays_min: wp.int32,
    lift: wp.float32,
    # in
    origin: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    # out
    ambient_out: wp.array(dtype=wp.uint8),
):
    """Share of the sky before ``normal`` [V] that is free at ``origin`` [V], in 1/255.

    A vertex that sees nothing at all may belong to a mesh turned inside out: then what it sees on
    its other side counts.
    """
    i = wp.tid()
    n = normal[i]
    p = origin[i]
    share = _free_share(mesh, rays, far, sky_rays_min, p + n * lift, n, True)
    if share == 0:
        share = wp.max(0, _free_share(mesh, rays, far, sky_rays_min, p - n * lift, -n, False))
    ambient_out[i] = wp.uint8(share)


def baked(meshes: Sequence[Mesh]) -> list[Mesh]:
    """The meshes with :attr:`Mesh.ambient` filled in; each is alone in the world."""
    key = hashlib.sha256(f"ambient {VERSION} {RINGS} {SECTORS} {FAR_M}".encode())
    for mesh in meshes:
        key.update(np.array([len(mesh.points_m), len(mesh.faces)], "<i8").tobytes())
        key.update(mesh.points_m.astype("<f4").tobytes())
        key.update(mesh.faces.astype("<i4").tobytes())
        key.update((mesh.material == materials.FOLIAGE).tobytes())
        if mesh.details is not None:
            key.update(_rounded(mesh).tobytes())
    prepare_kernels()
    path = kept_folder("ambient") / f"{key.hexdigest()}.u8"
    counts = [len(mesh.points_m) for mesh in meshes]
    values = _read(path, sum(counts))
    if values is None:
        values = np.concatenate([bake(mesh) for mesh in meshes])
        _write(path, values)
    parts = np.split(values.astype(np.float32) / np.float32(255.0), np.cumsum(counts)[:-1])
    return [replace(mesh, ambient=part) for mesh, part in zip(meshes, parts, strict=True)]


def bake(mesh: Mesh) -> np.ndarray:
    """uint8 [V]: share of the sky that each vertex sees, in 1/255."""
    prepare_kernels()
    device = wp.get_device("cpu")
    normal, inward = _vertex_frames(mesh)
    origin = mesh.points_m + inward
    points = wp.array(mesh.points_m, dtype=wp.vec3, device=device)
    indices = wp.array(mesh.faces.ravel(), dtype=wp.int32, device=device)
    target = wp.Mesh(points, indices, bvh_constructor="sah", bvh_leaf_size=8)
    out = wp.zeros(len(mesh.points_m), dtype=wp.uint8, device=device)
    wp.launch(
        ambient_kernel,
        len(mesh.points_m),
        inputs=[
            target.id,
            wp.array(directions(), dtype=wp.vec3, device=device),
            FAR_M,
            _SKY_RAYS_MIN,
            _LIFT_M,
            wp.array(origin, dtype=wp.vec3, device=device),
            wp.array(normal, dtype=wp.vec3, device=device),
        ],
        outputs=[out],
        device=device,
    )
    return _through_leaves(mesh, out.numpy())


def _through_leaves(mesh: Mesh, values: np.ndarray) -> np.ndarray:
    """Leaves let light through: a vertex of foliage gets at least :data:`LEAF_SHARE`."""
    leaves = np.zeros(len(values), bool)
    leaves[mesh.faces[mesh.material == materials.FOLIAGE]] = True
    raised = np.rint(255.0 * LEAF_SHARE + (1.0 - LEAF_SHARE) * values).astype(np.uint8)
    return np.where(leaves, raised, values)


def _vertex_frames(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals [V, 3], and the small way from each vertex towards its faces [V, 3].

    Without it a vertex on the line where floor and wall meet would lie in the wall.
    """
    corners = mesh.points_m[mesh.faces].astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    centre = corners.mean(axis=1)
    area = np.linalg.norm(cross, axis=1)
    normal, middle = np.zeros((len(mesh.points_m), 3)), np.zeros((len(mesh.points_m), 3))
    weight = np.zeros(len(mesh.points_m))
    for corner in range(3):
        index = mesh.faces[:, corner]
        np.add.at(normal, index, cross)
        np.add.at(middle, index, centre * area[:, None])
        np.add.at(weight, index, area)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    unit = np.where(length > 0, normal / np.maximum(length, 1e-30), (0.0, 0.0, 1.0))
    # A vertex of no face, or of faces without area, stays where it is.
    used = weight > 0
    middle[used] /= weight[used, None]
    way = np.where(used[:, None], middle - mesh.points_m, 0.0)
    reach = np.linalg.norm(way, axis=1, keepdims=True)
    way *= np.minimum(_INWARD_M, 0.5 * reach) / np.maximum(reach, 1e-30)
    if mesh.details is not None:
        # Towards the faces of a round body is into it.
        inside = (way * unit).sum(axis=1, keepdims=True) * unit
        way = np.where(_rounded(mesh)[:, None], way - inside, way)
    return unit.astype(np.float32), way.astype(np.float32)


def _rounded(mesh: Mesh) -> np.ndarray:
    """Vertices of faces with normals at their corners, bool [V]."""
    found = np.zeros(len(mesh.points_m), bool)
    if mesh.details is not None and len(mesh.details.normal):
        row = mesh.details.row
        smooth = np.abs(mesh.details.normal).sum(axis=(1, 2)) > 0.0
        found[mesh.faces[(row >= 0) & smooth[row]]] = True
    return found


def _read(path: Path, count: int) -> np.ndarray | None:
    try:
        data = path.read_bytes()
    except OSError:
        return None
    return np.frombuffer(data, np.uint8) if len(data) == count else None


def _write(path: Path, values: np.ndarray) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, values.tobytes())
    except OSError:
        pass  # a cache that cannot be written only costs time
