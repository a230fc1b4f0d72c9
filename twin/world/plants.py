"""Trees: a trunk and a few rough clumps of leaves."""

from __future__ import annotations

import numpy as np

from twin.world import materials
from twin.world.mesh import Color, MeshBuilder

_BARK: Color = (0.10, 0.075, 0.055)


def _ball() -> tuple[np.ndarray, np.ndarray]:
    """Unit icosahedron, each face divided by four: 42 points, 80 faces."""
    g = (1.0 + 5.0**0.5) / 2.0
    points = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    points += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    corners = np.array(points, float) / np.linalg.norm((1.0, g))
    # Faces: triples of corners that are mutual nearest neighbours, turned to face outwards.
    near = np.linalg.norm(corners[:, None] - corners[None], axis=-1) < 1.2
    faces = []
    for i in range(12):
        for j in range(i + 1, 12):
            for k in range(j + 1, 12):
                if near[i, j] and near[j, k] and near[i, k]:
                    normal = np.cross(corners[j] - corners[i], corners[k] - corners[i])
                    faces.append((i, j, k) if normal @ corners[i] > 0 else (i, k, j))
    split: list[np.ndarray] = list(corners)
    index: dict[tuple[int, int], int] = {}

    def middle(a: int, b: int) -> int:
        key = (min(a, b), max(a, b))
        if key not in index:
            index[key] = len(split)
            point = split[a] + split[b]
            split.append(point / np.linalg.norm(point))
        return index[key]

    fine = []
    for i, j, k in faces:
        a, b, c = middle(i, j), middle(j, k), middle(k, i)
        fine += [(i, a, c), (a, j, b), (c, b, k), (a, b, c)]
    return np.array(split), np.array(fine)


_BALL = _ball()


def add_tree(
    mesh: MeshBuilder, x_m: float, y_m: float, z_m: float, rng: np.random.Generator
) -> None:
    """Add a street tree of 5 to 8 m."""
    height = rng.uniform(4.6, 6.4)
    lean = rng.uniform(-0.15, 0.15, 2)
    crown = (x_m + lean[0], y_m + lean[1], z_m + 0.62 * height)
    mesh.tube((x_m, y_m, z_m), crown, (0.15, 0.09), 6, materials.PLAIN, _BARK)
    points, faces = _BALL
    for clump in range(3):
        radius = rng.uniform(1.05, 1.5) * (1.0 if clump else 1.15)
        spread = rng.uniform(-0.8, 0.8, 2) if clump else np.zeros(2)
        lift = rng.uniform(-0.3, 0.9) if clump else 0.2
        centre = np.array([x_m + spread[0], y_m + spread[1], z_m + 0.72 * height + lift])
        rough = points * (radius * rng.uniform(0.78, 1.18, len(points)))[:, None]
        green = rng.uniform(0.8, 1.2)
        color: Color = (0.065 * green, 0.12 * green, 0.035 * green)
        mesh.add(centre + rough * (1.0, 1.0, 0.9), faces, materials.FOLIAGE, color)
