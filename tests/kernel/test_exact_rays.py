"""Rays of sensors whose bytes are the same on every device, by the code of a CPU and of a GPU."""

from __future__ import annotations

import numpy as np
import trimesh
import warp as wp

from twin.render.trace import bvh, traverse
from twin.render.trace.exact import closest_exact, exact_closest

CPU = "cpu"


@wp.func_native(exact_closest(traverse.closest_scalar.native_snippet))
def closest_exact_scalar(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    root: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    far: wp.float32,
) -> wp.vec4:
    """What a GPU finds."""


@wp.kernel(module_options={"fuse_fp": False}, module="unique")
def both_kernel(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    scalar_nodes: wp.array(dtype=wp.float32),
    scalar_leaves: wp.array(dtype=wp.float32),
    origin: wp.vec3,
    rays: wp.array(dtype=wp.vec3),
    exact_out: wp.array2d(dtype=wp.vec4),
    first_out: wp.array2d(dtype=wp.vec4),
):
    i = wp.tid()
    far = wp.float32(60.0)
    exact_out[i, 0] = closest_exact(nodes, leaves, 0, origin, rays[i], far)
    exact_out[i, 1] = closest_exact_scalar(scalar_nodes, scalar_leaves, 0, origin, rays[i], far)
    first_out[i, 0] = traverse.closest(nodes, leaves, 0, origin, rays[i], far)
    first_out[i, 1] = traverse.closest_scalar(scalar_nodes, scalar_leaves, 0, origin, rays[i], far)


def test_rays_through_edges_meet_the_same_face_by_the_code_of_every_device():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=20.0)
    edges = ball.vertices[ball.edges_unique].mean(axis=1)
    rays = np.concatenate([ball.vertices, edges])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    words = []
    for shape in (bvh.CPU, bvh.CUDA):
        built = bvh.build_bvh(ball.vertices.astype(np.float32), ball.faces, shape)
        words += [wp.array(w, dtype=wp.float32, device=CPU) for w in built.words(0, 0, shape)]
    exact, first = (wp.zeros((len(rays), 2), dtype=wp.vec4, device=CPU) for _ in range(2))
    inputs = [*words, wp.vec3(0.0, 0.0, 0.0), wp.array(rays, dtype=wp.vec3, device=CPU)]
    wp.launch(both_kernel, len(rays), inputs, [exact, first], device=CPU)
    bits = exact.numpy().view(np.int32)
    assert (bits[:, 0, 3] >= 0).all()
    assert (bits[:, 0] == bits[:, 1]).all()
    others = first.numpy().view(np.int32)
    assert (others[:, 0, 3] != others[:, 1, 3]).any(), "no ray met two faces at one distance"
