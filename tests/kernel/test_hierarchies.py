"""Hierarchies of rays: which faces and boxes they have, and how their wide nodes are chosen."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from twin.render.trace import bvh

SHAPES = {"cpu": bvh.CPU, "cuda": bvh.CUDA}


def soup(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """``count`` triangles of all sizes [m]: corners [3 N, 3] and faces [N, 3]."""
    rng = np.random.default_rng(seed)
    size = np.exp(rng.uniform(-3, 2, (count, 1, 1)))
    corners = rng.uniform(-50, 50, (count, 1, 3)) + size * rng.normal(size=(count, 3, 3))
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * count).reshape(-1, 3)


def faces_below(built: bvh.Bvh, shape: bvh.BvhWidth, link: int) -> list[int]:
    """Faces of a child, in the order of its leaf."""
    if shape.packed:
        faces = built.leaves.view(np.int32)[-1 - link, 9]
        return faces[faces >= 0].tolist()
    first, count = divmod(-1 - link, 16)
    return built.leaves.view(np.int32)[first : first + count, 0, 3].tolist()


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES.keys())
@pytest.mark.parametrize("count", [1, 2, 5, 3000])
def test_every_face_is_in_one_leaf_and_in_all_boxes_above(shape: bvh.BvhWidth, count: int) -> None:
    points, faces = soup(count, 4)
    built = bvh.build_bvh(points, faces, shape)
    links = built.nodes.view(np.int32)[:, 6]
    corners = points[faces]

    def check(node: int) -> list[int]:
        below = []
        for place, link in enumerate(links[node].tolist()):
            if link == bvh.NOBODY:
                assert (built.nodes[node, :3, place] == np.inf).all()
                continue
            own = check(link) if link >= 0 else faces_below(built, shape, link)
            low, high = built.nodes[node, :3, place], built.nodes[node, 3:6, place]
            assert own
            assert (corners[own] >= low).all()
            assert (corners[own] <= high).all()
            below += own
        return below

    assert sorted(check(0)) == list(range(count))


def test_faces_with_one_centre_are_halved_as_they_stand() -> None:
    points = np.tile(np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), (100, 1))
    built = bvh.build_bvh(points, np.arange(300).reshape(-1, 3), bvh.CUDA)
    numbers = built.leaves.view(np.int32)[:, 0, 3]
    assert sorted(numbers.tolist()) == list(range(100))


@pytest.mark.parametrize("width", [4, 8])
def test_areas_of_wide_nodes_add_up_to_the_least(width: int) -> None:
    points, faces = soup(40, width)
    binary, wide = bvh.BvhWidth(2, 1, packed=False), bvh.BvhWidth(width, 1, packed=False)
    tree, built = bvh.build_bvh(points, faces, binary), bvh.build_bvh(points, faces, wide)

    def children(of: bvh.Bvh, node: int) -> list[int]:
        return [n for n in of.nodes.view(np.int32)[node, 6].tolist() if n != bvh.NOBODY]

    def faces_of(of: bvh.Bvh, link: int) -> list[int]:
        if link < 0:
            return faces_below(of, binary, link)
        return [face for child in children(of, link) for face in faces_of(of, child)]

    def area(of: bvh.Bvh, node: int) -> float:
        corners = points[faces[faces_of(of, node)]].reshape(-1, 3)
        x, y, z = (corners.max(axis=0) - corners.min(axis=0)).astype(float).tolist()
        return x * (y + z) + y * z

    @cache
    def least(link: int, places: int) -> float:
        """Of all ways to give what is below a node of the binary tree so many places."""
        if link < 0:
            return 0.0
        whole = area(tree, link) + opened(link, width)
        return whole if places == 1 else min(whole, opened(link, places))

    def opened(node: int, places: int) -> float:
        left, right = children(tree, node)
        return min(least(left, k) + least(right, places - k) for k in range(1, places))

    assert all(len(children(built, node)) <= width for node in range(len(built.nodes)))
    total = sum(area(built, node) for node in range(len(built.nodes)))
    assert total == pytest.approx(area(tree, 0) + opened(0, width), rel=1e-6)
