"""What stands along the curves of a road: straight fronts that follow them, and small squares."""

from __future__ import annotations

import math

import numpy as np

from twin.world.meshes import materials
from twin.world.meshes.mesh import Color, MeshBuilder
from twin.world.scene import Scene
from twin.world.street import furniture as pieces
from twin.world.street import plants
from twin.world.street.buildings import add_house, near_obstacle
from twin.world.street.ground import strip_floor
from twin.world.street.layout import Hull, Layout, StreetBlock, generator

_TURN_MAX_RAD = math.radians(22.0)
"""Between one front and the next."""
_SQUARE_MIN_M = 3.0
_PAVING: Color = (0.27, 0.25, 0.22)


def add_bends(mesh: MeshBuilder, scene: Scene, layout: Layout) -> list[Hull]:
    """Add buildings and squares along the curves of the street; returns their hulls."""
    rng = generator(scene, 6)
    hulls: list[Hull] = []
    for block in layout.blocks:
        if block.curvature == 0.0:
            continue
        for _, wall, sign in layout.rows():
            if layout.has_square(block, sign):
                hulls += _square(mesh, scene, layout, block, (wall, sign), rng)
            else:
                with mesh.label("building"):
                    hulls += _row(mesh, scene, layout, block, (wall, sign), rng)
    return hulls


def _row(
    mesh: MeshBuilder,
    scene: Scene,
    layout: Layout,
    block: StreetBlock,
    row: tuple[float, float],
    rng: np.random.Generator,
) -> list[Hull]:
    """Fronts of one width along a curve.

    Outside of it they touch the wall's line in their middle and each other at their corners; their
    backs spread. Inside they are chords of the wall's line, and run into each other behind it.
    """
    wall, sign = row
    radius = layout.centre_distance(block, wall)
    length = block.end - block.start
    turn = length * abs(block.curvature)
    outside = block.curvature * sign < 0.0
    wanted = turn * radius / (sum(scene.buildings.width_m) / 2)
    count = max(math.ceil(turn / _TURN_MAX_RAD), round(wanted))
    half_turn = turn / count / 2
    half = radius * (math.tan(half_turn) if outside else math.sin(half_turn))
    front = wall if outside else wall + sign * radius * (1.0 - math.cos(half_turn))
    hulls: list[Hull] = []
    for i in range(count):
        x0, x1 = (block.start + length * k / count for k in (i, i + 1))
        height = rng.uniform(*scene.buildings.height_m)
        middle = ((x0 + x1) / 2, front, sign)
        size, relief = (2 * half, height), near_obstacle(scene, layout, x0, x1)
        hulls.append(add_house(mesh, scene, layout, middle, size, (False, False), rng, relief))
    return hulls


def _square(
    mesh: MeshBuilder,
    scene: Scene,
    layout: Layout,
    block: StreetBlock,
    row: tuple[float, float],
    rng: np.random.Generator,
) -> list[Hull]:
    """A paved corner between the flanks of two rows, with trees and benches."""
    wall, sign = row
    z = scene.road.kerb_height_m
    radius = layout.centre_distance(block, wall)
    if radius < _SQUARE_MIN_M:
        return []
    far = 1.0 / block.curvature - sign * 0.2
    across = (min(wall, far), max(wall, far))
    with mesh.label("sidewalk"):
        strip_floor(
            mesh, layout, (block.start, block.end), across, z, materials.PAVING, _PAVING, 3.0
        )
    hulls: list[Hull] = []
    kind = plants.KINDS[rng.integers(len(plants.KINDS))]
    for share, deep in ((0.25, 0.35), (0.5, 0.55), (0.75, 0.35)):
        x = block.start + share * (block.end - block.start)
        at = layout.at(x, wall + sign * deep * radius)
        plants.add_tree(mesh, *at[:2], z, kind, rng)
        hulls.append((*at, 0.16, 0.16))
    for share in (0.4, 0.6):
        x = block.start + share * (block.end - block.start)
        at = layout.at(x, wall + sign * 0.12 * radius, 0.0 if sign > 0 else math.pi)
        with mesh.place(*at, z_m=z):
            pieces.add_bench(mesh)
        hulls.append((*at, 0.9, 0.26))
    return hulls
