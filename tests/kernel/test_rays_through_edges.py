"""Rays through edges and corners: the same bits by the code of a CPU and of a GPU."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
import warp as wp

from twin.render.trace import bvh, traverse

CPU = "cpu"


@wp.kernel(module_options={"fuse_fp": False}, module="unique")
def both_kernel(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    scalar_nodes: wp.array(dtype=wp.float32),
    scalar_leaves: wp.array(dtype=wp.float32),
    origin: wp.vec3,
    rays: wp.array(dtype=wp.vec3),
    near: wp.float32,
    out: wp.array2d(dtype=wp.vec4),
):
    i = wp.tid()
    far = wp.float32(1200.0)
    out[i, 0] = traverse.closest(nodes, leaves, 0, origin, rays[i], near, far)
    out[i, 1] = traverse.closest_scalar(scalar_nodes, scalar_leaves, 0, origin, rays[i], near, far)


def hits(points, faces, origin, rays, near_m=0.0):
    """Bits of the hits [N, 2, 4] by the code of a CPU and of a GPU."""
    words = []
    for shape in (bvh.CPU, bvh.CUDA):
        built = bvh.build_bvh(points.astype(np.float32), faces, shape)
        words += [wp.array(w, dtype=wp.float32, device=CPU) for w in built.words(0, 0, shape)]
    out = wp.zeros((len(rays), 2), dtype=wp.vec4, device=CPU)
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    inputs = [*words, wp.vec3(*origin), wp.array(rays, dtype=wp.vec3, device=CPU), near_m]
    wp.launch(both_kernel, len(rays), inputs, [out], device=CPU)
    return out.numpy().view(np.int32)


def test_corners_and_edges_of_a_ball():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=20.0)
    edges = ball.vertices[ball.edges_unique].mean(axis=1)
    bits = hits(ball.vertices, ball.faces, (0.0, 0.0, 0.0), np.concatenate([edges, ball.vertices]))
    assert (bits[: len(edges), 0, 3] >= 0).all()
    assert (bits[len(edges) :, 0, 3] >= 0).mean() > 0.99, "rays slip through corners"
    assert (bits[:, 0] == bits[:, 1]).all()


@pytest.mark.parametrize("height_m", [1.4, 0.05, 0.002])
def test_a_street_that_is_met_at_grazing_angles(height_m):
    """Long thin faces to the horizon, two of them in every place: the lower number counts."""
    x = np.concatenate([[-50.0], np.geomspace(0.5, 900.0, 60)])
    y = np.linspace(-8.0, 8.0, 33)
    grid = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), -1).reshape(-1, 3)
    at = np.arange(len(x) * len(y)).reshape(len(x), len(y))
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    faces = np.concatenate([np.stack(f, -1).reshape(-1, 3) for f in ((a, b, c), (a, c, d))])
    twice = np.concatenate([faces, faces[::-1]])
    rng = np.random.default_rng(5)
    places = grid[rng.integers(0, len(grid), 6000)]
    places = np.concatenate([places, rng.uniform((0.0, -9.0, 0.0), (900.0, 9.0, 0.0), (6000, 3))])
    eye = np.array([0.3, 0.1, height_m])
    bits = hits(grid, twice, eye, places - eye)
    face = bits[:, 0, 3]
    assert (face >= 0).mean() > 0.8
    assert (bits[:, 0] == bits[:, 1]).all()
    assert (face < len(faces)).all(), "of two faces in one place the first counts"


def test_nothing_nearer_than_the_nearest_distance_is_met():
    walls = [trimesh.creation.box((0.1, 9.0, 9.0)) for _ in range(2)]
    walls[0].apply_translation((2.0, 0.0, 0.0))
    walls[1].apply_translation((5.0, 0.0, 0.0))
    both = trimesh.util.concatenate(walls)
    rays = np.array([(1.0, 0.0, 0.0), (1.0, 0.1, 0.05)])
    for near, expected in ((0.0, 1.95), (1.9, 1.95), (1.99, 2.05), (3.0, 4.95)):
        bits = hits(both.vertices, both.faces, (0.0, 0.0, 0.0), rays, near)
        assert (bits[:, 0] == bits[:, 1]).all()
        assert bits.view(np.float32)[0, 0, 0] == pytest.approx(expected, abs=1e-5)
