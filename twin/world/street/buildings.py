"""Rows of buildings along the street and its side streets, and those that close its views."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from twin.world.meshes import materials
from twin.world.meshes.mesh import Color, MeshBuilder
from twin.world.scene import Scene
from twin.world.street import facade
from twin.world.street.layout import SIDE_REACH_M, SIDE_WALK_M, Hull, Layout, StreetBlock, generator

_ROOF: Color = (0.17, 0.165, 0.16)
_METAL: Color = (0.42, 0.43, 0.44)
_SIDE_DEPTH_M = 12.0
NEAR_M = (200.0, 70.0)
"""Fronts this far before and behind the obstacle have relief: the way of the ego [m]."""
_WIDTH_MIN_M = 3.0
_YARD_WALL_M = (0.3, 2.6)
"""Thickness and height of the wall where there is no room for a building [m]."""
_YARD_BRICK: Color = (0.33, 0.17, 0.12)
_CLOSING_M = 12.0
"""Distance of the buildings that close the street behind its ends [m]."""


def add_buildings(mesh: MeshBuilder, scene: Scene, layout: Layout) -> list[Hull]:
    """Add all buildings but those along curves (:mod:`twin.world.street.bends`); returns the
    hulls of those that a vehicle can reach."""
    rng = generator(scene, 1)
    hulls: list[Hull] = []
    with mesh.label("building"):
        for block in layout.blocks:
            for _, wall, sign in layout.rows():
                if block.curvature == 0.0:
                    hulls += _main_row(mesh, scene, layout, block, (wall, sign), rng)
        for centre in layout.sides:
            for _, wall, sign in layout.rows():
                hulls += _side_rows(mesh, scene, layout, centre, (wall, sign), rng)
        if not layout.lane.closed:
            hulls += _closing_rows(mesh, scene, layout, rng)
    return hulls


def _main_row(
    mesh: MeshBuilder,
    scene: Scene,
    layout: Layout,
    block: StreetBlock,
    row: tuple[float, float],
    rng: np.random.Generator,
) -> list[Hull]:
    wall, sign = row
    low, high = scene.buildings.width_m
    start, end = block.walls
    hulls = []
    x = start
    while x < end - 0.5:
        width = rng.uniform(low, high)
        right = end if end - x - width < low else x + width
        height = rng.uniform(*scene.buildings.height_m)
        front = ((x + right) / 2, wall, sign)
        opens = block.opens or layout.square_beside(block, -1, sign)
        closes = block.closes or layout.square_beside(block, 1, sign)
        first, last = x == start and opens, right == end and closes
        flanks = (first, last) if sign > 0 else (last, first)
        relief = near_obstacle(scene, layout, x, right)
        size = (right - x, height)
        hulls.append(add_house(mesh, scene, layout, front, size, flanks, rng, relief))
        x = right
    return hulls


def add_house(
    mesh: MeshBuilder,
    scene: Scene,
    layout: Layout,
    front: tuple[float, float, float],
    size_m: tuple[float, float],
    flanks: tuple[bool, bool],
    rng: np.random.Generator,
    relief: bool,
) -> Hull:
    """A building as deep as there is room for, or a yard's wall where there is none; its hull.

    Args:
        front: x, y [m] of the middle of its front, in street coordinates, and the sign of the
            side of the street.
        size_m: width, height.
        flanks, relief: see :func:`add_building`.
    """
    along, wall, sign = front
    width, height = size_m
    # In its own axes a building's width runs along +x from its corner, its depth to +y.
    x, y, yaw = layout.at(along, wall, 0.0 if sign > 0 else np.pi)
    corner = (x - width / 2 * math.cos(yaw), y - width / 2 * math.sin(yaw), yaw)
    depth = _free_depth(layout, (x, y, yaw), width, scene.buildings.depth_m)
    if depth == 0.0 or width < _WIDTH_MIN_M:
        depth = _YARD_WALL_M[0]
        with mesh.place(*corner), mesh.label("wall"):
            mesh.box((0.0, 0.0, 0.0), (width, *_YARD_WALL_M), materials.BRICK, _YARD_BRICK)
    else:
        add_building(mesh, corner, (width, depth, height), flanks, rng, relief)
    return (*layout.at(along, wall + sign * depth / 2), width / 2, depth / 2)


def _free_depth(
    layout: Layout, front: tuple[float, float, float], width_m: float, depth_m: float
) -> float:
    """Depth that a building may have without standing in a street; 0: not even a shallow one
    [m]."""
    if not layout.lane.closed:
        return depth_m
    x, y, yaw = front
    c, s = math.cos(yaw), math.sin(yaw)
    across = np.linspace(-width_m / 2, width_m / 2, 5)
    for share in (1.0, 0.8, 0.6, 0.4):
        along, back = np.meshgrid(across, share * depth_m * np.array((0.25, 0.5, 0.75, 1.0)))
        if not layout.on_street(x + c * along - s * back, y + s * along + c * back).any():
            return share * depth_m
    return 0.0


def near_obstacle(scene: Scene, layout: Layout, x0: float, x1: float) -> bool:
    """Whether the ego comes past what stands along the street from ``x0`` to ``x1`` on its way to
    the obstacle, or sees it from there. Without one, its way begins with the road."""
    first, last = x0 - NEAR_M[1], x1 + NEAR_M[0]
    obstacle = scene.obstacle
    goal_m = scene.road.start_m + NEAR_M[0] if obstacle is None else obstacle.x_m
    if layout.lane.closed:
        return (goal_m - first) % layout.lane.length_m < last - first
    return first < goal_m < last


def _side_rows(
    mesh: MeshBuilder,
    scene: Scene,
    layout: Layout,
    centre: float,
    row: tuple[float, float],
    rng: np.random.Generator,
) -> list[Hull]:
    """The two fronts of a side street beyond the corner buildings, and the house at its end."""
    wall, sign = row
    low, high = scene.buildings.width_m
    offset = layout.half_side + SIDE_WALK_M
    hulls = []
    begin = abs(wall - layout.middle) + scene.buildings.depth_m
    for side in (-1.0, 1.0):
        front = centre + side * offset
        reach = begin
        while reach < SIDE_REACH_M - 1.0:
            width = rng.uniform(low, high)
            if SIDE_REACH_M - reach - width < low:
                width = SIDE_REACH_M - reach
            y0, y1 = sorted(layout.middle + sign * np.array((reach, reach + width)))
            # Fronts look along x towards the side street's axis.
            corner = (front, y0, np.pi / 2) if side < 0 else (front, y1, -np.pi / 2)
            size = (width, _SIDE_DEPTH_M, rng.uniform(*scene.buildings.height_m) * 0.8)
            add_building(mesh, corner, size, (False, False), rng, relief=False)
            hulls.append(_hull(front, front + side * _SIDE_DEPTH_M, y0, y1))
            reach += width
    end = layout.middle + sign * (SIDE_REACH_M + 6.0)
    half = offset + _SIDE_DEPTH_M
    corner = (centre - half, end, 0.0) if sign > 0 else (centre + half, end, np.pi)
    size = (2 * half, 12.0, rng.uniform(14.0, 26.0))
    add_building(mesh, corner, size, (False, False), rng, relief=False)
    hulls.append(_hull(centre - half, centre + half, end, end + sign * 12.0))
    return hulls


def _closing_rows(
    mesh: MeshBuilder, scene: Scene, layout: Layout, rng: np.random.Generator
) -> list[Hull]:
    hulls = []
    road = scene.road
    cuts = layout.middle + np.array((-38.0, -15.0, 13.0, 38.0))
    for x, yaw in ((road.end_m + _CLOSING_M, -np.pi / 2), (road.start_m - _CLOSING_M, np.pi / 2)):
        for y0, y1 in pairwise(cuts):
            corner = (x, y1, yaw) if yaw < 0 else (x, y0, yaw)
            size = (y1 - y0, 14.0, rng.uniform(16.0, 34.0))
            add_building(mesh, corner, size, (False, False), rng, relief=yaw < 0)
            hulls.append(_hull(x, x - np.sign(yaw) * 14.0, y0, y1))
    return hulls


def _hull(x0: float, x1: float, y0: float, y1: float) -> Hull:
    return ((x0 + x1) / 2, (y0 + y1) / 2, 0.0, abs(x1 - x0) / 2, abs(y1 - y0) / 2)


def add_building(
    mesh: MeshBuilder,
    corner: tuple[float, float, float],
    size_m: tuple[float, float, float],
    flanks: tuple[bool, bool],
    rng: np.random.Generator,
    relief: bool = True,
) -> None:
    """One building.

    Args:
        corner: x, y [m] of the left end of its front as seen from the street, and its yaw [rad].
        size_m: width, depth, height.
        flanks: whether the left and the right side look at a street and have windows.
        relief: false leaves away what is only seen from near.
    """
    style = facade.random_style(rng)
    width, depth, height = size_m
    with mesh.place(*corner):
        _front(mesh, width, height, style, rng, relief)
        for side, open_ in zip((-1.0, 1.0), flanks, strict=True):
            at = (0.0, depth, -np.pi / 2) if side < 0 else (width, 0.0, np.pi / 2)
            with mesh.place(*at):
                if open_:
                    _front(mesh, depth, height, style, rng, relief)
                else:
                    _blank(mesh, depth, height, style)
        with mesh.place(width, depth, np.pi):
            _blank(mesh, width, height, style)
        _roof(mesh, size_m, style, rng, relief)


def _front(
    mesh: MeshBuilder,
    width_m: float,
    height_m: float,
    style: facade.Style,
    rng: np.random.Generator,
    relief: bool,
) -> None:
    if not relief:
        facade.add_flat(mesh, width_m, height_m, style)
        return
    facade.add_shop(mesh, width_m, style, rng)
    ledge = (facade.SHOP_HEIGHT_M, facade.SHOP_HEIGHT_M + 0.3)
    cornice = (height_m - 0.85, height_m - 0.45)
    # Walls end at ledges: corners hidden in one would be dark and darken the wall around.
    facade.add_storeys(mesh, width_m, (ledge[1], cornice[0]), style)
    facade.beam(mesh, (0.0, width_m), 0.22, ledge, style.trim)
    facade.beam(mesh, (0.0, width_m), 0.45, cornice, style.trim)
    zero, one = np.zeros(1), np.ones(1)
    top = facade.upright(zero, width_m * one, 0.0, cornice[1] * one, height_m * one)
    mesh.quads(top, style.material, style.color, style.tag)


def _blank(mesh: MeshBuilder, width_m: float, height_m: float, style: facade.Style) -> None:
    """A wall without windows."""
    zero, one = np.zeros(1), np.ones(1)
    wall = facade.upright(zero, width_m * one, 0.0, zero, height_m * one)
    mesh.quads(wall, style.material, style.color, style.tag)


def _roof(
    mesh: MeshBuilder,
    size_m: tuple[float, float, float],
    style: facade.Style,
    rng: np.random.Generator,
    relief: bool,
) -> None:
    """A flat roof behind the walls' tops, or a mansard with dormers; and what stands on it."""
    width, depth, height = size_m
    low = height - 0.5
    kind = rng.random()
    if style.lintels and kind < 0.5:
        _mansard(mesh, size_m, style)
        low += 2.7
    else:
        flat = [(0.0, 0.0, low), (width, 0.0, low), (width, depth, low), (0.0, depth, low)]
        mesh.quad(flat, materials.PLAIN, _ROOF)
    if not relief:
        return
    for _ in range(int(rng.integers(1, 3))):  # machines and stair heads
        x, y = rng.uniform(1.0, max(1.5, width - 4.0)), rng.uniform(3.0, max(3.5, depth - 4.0))
        a, b, c = rng.uniform(1.0, 2.8), rng.uniform(1.0, 2.4), rng.uniform(0.8, 2.6)
        mesh.box((x, y, low), (x + a, y + b, low + c), materials.PLAIN, _METAL)
    for _ in range(int(rng.integers(0, 2))):  # chimneys
        x = rng.uniform(0.5, width - 1.2)
        stack = (x + 0.7, 2.2, low + 1.9)
        mesh.box((x, 1.5, low), stack, materials.BRICK, (0.33, 0.17, 0.13), style.tag)
        pot = (x + 0.35, 1.85, low + 1.9)
        mesh.tube(pot, (*pot[:2], low + 2.3), (0.14, 0.12), 6, materials.PLAIN, (0.4, 0.2, 0.13))
    if rng.random() < 0.4:  # mast
        at = (rng.uniform(1.0, width - 1.0), rng.uniform(2.0, depth - 1.0))
        mesh.tube((*at, low), (*at, low + 4.5), (0.05, 0.03), 4, materials.PLAIN, _METAL)


def _mansard(mesh: MeshBuilder, size_m: tuple[float, float, float], style: facade.Style) -> None:
    width, depth, height = size_m
    low, high, slant = height - 0.1, height + 2.2, 1.1
    slate: Color = (0.09, 0.095, 0.105)
    a = [(0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth)]
    b = [(0.0, slant), (width, slant), (width, depth - slant), (0.0, depth - slant)]
    for i in range(4):
        j = (i + 1) % 4
        corners = [(*a[i], low), (*a[j], low), (*b[j], high), (*b[i], high)]
        mesh.quad(corners, materials.PLAIN, slate)
    mesh.quad([(*p, high) for p in b], materials.PLAIN, _ROOF)
    count = max(1, int(width / 4.0))
    for x in (np.arange(count) + 0.5) * width / count:
        x0, x1, top = x - 0.65, x + 0.65, high - 0.35
        mesh.box((x0, 0.12, low), (x1, slant, top), materials.PLAIN, slate)
        one = np.ones(1)
        across = ((x0 + 0.15) * one, (x1 - 0.15) * one)
        pane = facade.upright(*across, 0.10, (low + 0.4) * one, (top - 0.25) * one)
        mesh.quads(pane, materials.WINDOW, (0.028, 0.034, 0.040), style.tag + int(x * 10))
