"""Hull overlap and distance against a NumPy reference that samples outlines densely."""

import math

import numpy as np
import pytest
import warp as wp

from twin.vehicle.hull import hull_at, overlap, separation
from twin.world.kernel_cache import prepare_kernels

prepare_kernels()
wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def pair_kernel(boxes: wp.array3d(dtype=wp.float64), out: wp.array2d(dtype=wp.float64)):
    i = wp.tid()
    a = hull_at(boxes[i, 0, 0], boxes[i, 0, 1], boxes[i, 0, 2], boxes[i, 0, 3], boxes[i, 0, 4])
    b = hull_at(boxes[i, 1, 0], boxes[i, 1, 1], boxes[i, 1, 2], boxes[i, 1, 3], boxes[i, 1, 4])
    way = separation(a, b)
    out[i, 0] = way[0]
    out[i, 1] = way[1]
    out[i, 2] = way[2]
    out[i, 3] = wp.where(overlap(a, b), wp.float64(1.0), wp.float64(0.0))


def run(pairs):
    boxes = wp.array(np.asarray(pairs, float), dtype=wp.float64, device="cpu")
    out = wp.zeros((len(pairs), 4), dtype=wp.float64, device="cpu")
    wp.launch(pair_kernel, len(pairs), inputs=[boxes], outputs=[out], device="cpu")
    return out.numpy()


def corners(box):
    x, y, yaw, a, b = box
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    return np.array([[a, b], [-a, b], [-a, -b], [a, -b]]) @ turn.T + (x, y)


def reference(one, two):
    """Smallest distance of a corner of one to an edge of the other, and whether they overlap."""
    best = np.inf
    p, q = corners(one), corners(two)
    apart = False
    for points, edges in ((p, q), (q, p)):
        for i in range(4):
            a, b = edges[i], edges[(i + 1) % 4]
            t = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            best = min(best, np.linalg.norm(a + t[:, None] * (b - a) - points, axis=1).min())
            normal = np.array([(b - a)[1], -(b - a)[0]])
            own, other = edges @ normal, points @ normal
            apart |= own.max() < other.min() or other.max() < own.min()
    return (best, False) if apart else (0.0, True)


def test_random_pairs_match_the_reference():
    rng = np.random.default_rng(5)
    pairs = np.empty((400, 2, 5))
    pairs[..., :2] = rng.uniform(-5, 5, (400, 2, 2))
    pairs[..., 2] = rng.uniform(-4, 4, (400, 2))
    pairs[..., 3:] = rng.uniform(0.3, 3, (400, 2, 2))
    out = run(pairs)
    expected = [reference(*pair) for pair in pairs]
    assert 50 < sum(e[1] for e in expected) < 350
    np.testing.assert_array_equal(out[:, 3], [float(e[1]) for e in expected])
    np.testing.assert_allclose(out[:, 2], [e[0] for e in expected], atol=1e-12)
    np.testing.assert_allclose(np.hypot(out[:, 0], out[:, 1]), out[:, 2], atol=1e-12)


def test_touching_is_overlap_and_a_gap_is_exact():
    touching = [(0, 0, 0, 2, 1), (4, 0, 0, 2, 1)]
    near = [(0, 0, 0, 2, 1), (4.25, 0.5, 0, 2, 1)]
    out = run([touching, near])
    assert out[0].tolist() == [0.0, 0.0, 0.0, 1.0]
    assert out[1].tolist() == [0.25, 0.0, 0.25, 0.0]


@pytest.mark.parametrize("yaw", [0.0, 0.3, math.pi / 2])
def test_way_points_from_the_first_to_the_second(yaw):
    x, y = 9 * math.cos(yaw), 9 * math.sin(yaw)
    out = run([[(0, 0, yaw, 2, 1), (x, y, yaw, 2, 1)]])[0]
    np.testing.assert_allclose(out[:3], [5 * math.cos(yaw), 5 * math.sin(yaw), 5], atol=1e-12)
