"""Simple solids with any direction: boxes, prisms over outlines, bands along lines."""

from __future__ import annotations

import numpy as np

from twin.road.beside.polygons import signed_area, triangles_of
from twin.world.meshes import materials
from twin.world.meshes.mesh import Color, MeshBuilder

_BOX_FACES = np.array(
    [(0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7), (3, 2, 1, 0)]
)
_CYLINDER_SIDES = 12


def add_box(
    mesh: MeshBuilder,
    foot_m: np.ndarray,
    axes: np.ndarray,
    size_m: tuple[float, float, float],
    material: int,
    color: Color,
    tag: int = 0,
) -> None:
    """A box with six sides.

    Args:
        mesh: receives it.
        foot_m: middle of its underside, world [3].
        axes: world directions of its length, width and height, the rows of [3, 3].
        size_m: length, width, height.
        material, color, tag: its surface.
    """
    half = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * 0.5 * np.array(size_m[:2])
    local = np.zeros((8, 3))
    local[:4, :2] = local[4:, :2] = half
    local[4:, 2] = size_m[2]
    corners = foot_m + local @ axes
    mesh.quads(corners[_BOX_FACES], material, color, tag)


def add_cylinder(
    mesh: MeshBuilder,
    foot_m: np.ndarray,
    axis: np.ndarray,
    radius_m: float,
    height_m: float,
    material: int,
    color: Color,
) -> None:
    """A round column with a lid; ``axis`` is its unit direction, up."""
    top = foot_m + height_m * axis
    ends = (foot_m.tolist(), top.tolist())
    mesh.tube(*ends, (radius_m, radius_m), _CYLINDER_SIDES, material, color)
    side = np.cross(axis, (0.0, 0.0, 1.0) if abs(axis[2]) < 0.9 else (1.0, 0.0, 0.0))
    side /= np.linalg.norm(side)
    angle = 2.0 * np.pi * np.arange(_CYLINDER_SIDES)[:, None] / _CYLINDER_SIDES
    ring = top + radius_m * (np.cos(angle) * side + np.sin(angle) * np.cross(axis, side))
    fan = np.array([(0, i, i + 1) for i in range(1, _CYLINDER_SIDES - 1)])
    mesh.add(ring, fan, material, color)


def add_prism(
    mesh: MeshBuilder,
    base_m: np.ndarray,
    height_m: np.ndarray,
    material: int,
    color: Color,
    tag: int = 0,
    top: tuple[int, Color] | None = None,
) -> None:
    """Walls over a closed outline and a lid; its underside is open.

    Args:
        mesh: receives it.
        base_m: corners of the underside [N, 3].
        height_m: of the lid above each corner [N].
        material, color, tag: of the walls.
        top: material and colour of the lid; None: those of the walls.
    """
    if signed_area(base_m[:, :2]) < 0.0:
        base_m, height_m = base_m[::-1], height_m[::-1]
    top_m = base_m + height_m[:, None] * np.array((0.0, 0.0, 1.0))
    if height_m.max() > 0.0:
        following = np.roll(np.arange(len(base_m)), -1)
        add_walls(mesh, base_m, top_m, following, material, color, tag)
    lid = top or (material, color)
    faces = triangles_of(base_m[:, :2])
    if len(faces):
        mesh.add(top_m, faces, *lid, tag)


def add_walls(
    mesh: MeshBuilder,
    base_m: np.ndarray,
    top_m: np.ndarray,
    following: np.ndarray,
    material: int,
    color: Color,
    tag: int = 0,
) -> None:
    """A wall from each of N corners to the one that ``following`` names, seen from the right of
    its way; patterns run along walls that have one."""
    for a, b in enumerate(following.tolist()):
        corners = np.array([base_m[a], base_m[b], top_m[b], top_m[a]])
        way = corners[1, :2] - corners[0, :2]
        if np.hypot(*way) < 1e-6:
            continue
        if material not in materials.WALLS:
            mesh.quads(corners[None], material, color, tag)
            continue
        yaw = float(np.arctan2(way[1], way[0]))
        c, s = np.cos(yaw), np.sin(yaw)
        shift = corners - (*corners[0, :2], 0.0)
        local = np.stack(
            [c * shift[:, 0] + s * shift[:, 1], -s * shift[:, 0] + c * shift[:, 1], shift[:, 2]],
            axis=1,
        )
        with mesh.place(float(corners[0, 0]), float(corners[0, 1]), yaw):
            mesh.quads(local[None], material, color, tag)


def add_band(
    mesh: MeshBuilder,
    left_m: np.ndarray,
    right_m: np.ndarray,
    height_m: np.ndarray,
    material: int,
    color: Color,
) -> None:
    """A body along a line: its sides, lid, underside and ends.

    Args:
        mesh: receives it.
        left_m, right_m: edges of its underside [N, 3].
        height_m: of the lid above them [N].
        material, color: its surface.
    """
    lift = height_m[:, None] * np.array((0.0, 0.0, 1.0))
    rails = np.stack([right_m, right_m + lift, left_m + lift, left_m], axis=1)
    a, b = rails[:-1], rails[1:]
    quads = [
        np.stack([a[:, k], b[:, k], b[:, (k + 1) % 4], a[:, (k + 1) % 4]], axis=1) for k in range(4)
    ]
    ends = np.stack([rails[0, ::-1], rails[-1]])
    mesh.quads(np.concatenate([*quads, ends]), material, color)
