"""Trees and shrubs: a trunk with branches and rough clumps of leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.world.meshes import materials
from twin.world.meshes.mesh import Color, MeshBuilder

_BARK: Color = (0.10, 0.075, 0.055)


def _ball(divided: bool) -> tuple[np.ndarray, np.ndarray]:
    """Unit icosahedron, 12 points and 20 faces; finer, each divided by four: 42 and 80."""
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
    if not divided:
        return corners, np.array(faces)
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


_BALL, _COARSE_BALL = _ball(divided=True), _ball(divided=False)


def _clump(
    mesh: MeshBuilder,
    centre: np.ndarray,
    radius_m: float,
    squash: float,
    green: Color,
    rng: np.random.Generator,
    ball: tuple[np.ndarray, np.ndarray] | None = None,
) -> None:
    points, faces = ball or _BALL
    rough = points * (radius_m * rng.uniform(0.84, 1.13, len(points)))[:, None]
    shade = rng.uniform(0.78, 1.22)
    color: Color = (green[0] * shade, green[1] * shade, green[2] * shade)
    mesh.add(centre + rough * (1.0, 1.0, squash), faces, materials.FOLIAGE, color)


@dataclass(frozen=True, slots=True)
class TreeKind:
    """Shape of a kind of tree; lengths as shares of its height."""

    height_m: tuple[float, float]
    trunk: float
    """Height of the lowest branches."""
    crown: float
    """Half width of the crown."""
    clumps: int
    green: Color
    column: float
    """0: a round crown; 1: a cone."""


KINDS = (
    TreeKind((6.2, 8.6), 0.34, 0.25, 5, (0.060, 0.115, 0.032), 0.0),  # lime
    TreeKind((5.0, 6.6), 0.38, 0.30, 4, (0.080, 0.130, 0.030), 0.2),  # maple
    TreeKind((7.5, 10.5), 0.24, 0.16, 4, (0.045, 0.100, 0.034), 0.8),  # hornbeam
    TreeKind((4.2, 5.4), 0.40, 0.28, 4, (0.100, 0.125, 0.028), 0.0),  # a young one
)


def add_tree(
    mesh: MeshBuilder,
    x_m: float,
    y_m: float,
    z_m: float,
    kind: TreeKind,
    rng: np.random.Generator,
) -> None:
    """Add a tree with its foot at (x, y, z)."""
    height = rng.uniform(*kind.height_m)
    foot = np.array((x_m, y_m, z_m))
    lean = np.array((*rng.uniform(-0.2, 0.2, 2), 0.0))
    fork = foot + lean * 0.5 + (0.0, 0.0, kind.trunk * height)
    thick = 0.022 * height
    with mesh.label("vegetation"):
        flare = foot + np.array((0.0, 0.0, 0.35))
        mesh.tube(foot, flare, (1.5 * thick, thick), 6, materials.PLAIN, _BARK)
        mesh.tube(flare, fork, (thick, 0.75 * thick), 6, materials.PLAIN, _BARK)
        top = height * (1.0 - kind.trunk)
        turn = rng.uniform(0, 2 * np.pi)
        for i in range(kind.clumps):
            share = i / max(1, kind.clumps - 1)  # from the lowest branch to the top
            angle = turn + 2.4 * i  # the golden angle spreads branches evenly
            reach = kind.crown * height * (1.0 - share) ** (0.5 + 0.5 * kind.column)
            reach *= rng.uniform(0.45, 0.72)
            side = np.array((np.cos(angle) * reach, np.sin(angle) * reach, 0.0))
            lift = np.array((0.0, 0.0, top * (0.22 + 0.56 * share)))
            centre = fork + lean * share + side + lift
            size = kind.crown * height * rng.uniform(0.66, 0.82) * (1.0 - 0.25 * share)
            if i < 3:
                mesh.tube(fork, centre, (0.5 * thick, 0.2 * thick), 4, materials.PLAIN, _BARK)
            _clump(mesh, centre, size, 0.9 + 0.65 * kind.column, kind.green, rng)


def add_shrub(
    mesh: MeshBuilder, x_m: float, y_m: float, z_m: float, rng: np.random.Generator
) -> None:
    """Add a clipped shrub of half a metre."""
    size = rng.uniform(0.34, 0.46)
    centre = np.array((x_m, y_m, z_m + 0.7 * size))
    with mesh.label("vegetation"):
        _clump(mesh, centre, size, 0.9, (0.05, 0.09, 0.03), rng, _COARSE_BALL)
