"""What stands where on the sidewalks: trees, lamps, signs, traffic lights, furniture."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.world.meshes.mesh import MeshBuilder
from twin.world.scene import Scene
from twin.world.street import furniture as pieces
from twin.world.street import plants, signs
from twin.world.street.layout import SIDE_WALK_M, Hull, Layout, StreetBlock, generator

STOP_SHARE = 0.3
"""Place of the bus stop along its block, on the left side [-]."""
STOP_M = 18.0
"""Length of the bus stop, free of parked cars [m]."""


def bus_stop(layout: Layout) -> tuple[float, float] | None:
    """x [m] from and to of the bus stop in the longest straight block; None: all are short."""
    straight = [block for block in layout.blocks if block.curvature == 0.0]
    block = max(straight, key=lambda b: b.end - b.start, default=None)
    if block is None or block.end - block.start < 60.0:
        return None
    middle = block.start + STOP_SHARE * (block.end - block.start)
    return (middle - STOP_M / 2, middle + STOP_M / 2)


def add_trees(mesh: MeshBuilder, scene: Scene, layout: Layout) -> list[Hull]:
    """Street trees near the kerbs, one kind per row of a block, with some of another kind."""
    rng = generator(scene, 4)
    hulls: list[Hull] = []
    stop = bus_stop(layout)
    for block in layout.blocks:
        for kerb, _, sign in layout.rows():
            kind = plants.KINDS[rng.integers(len(plants.KINDS))]
            first = block.start + 8.0 + rng.uniform(0, 5)
            for x in np.arange(first, block.end - 7.0, scene.furniture.tree_spacing_m):
                other = plants.KINDS[rng.integers(len(plants.KINDS))]
                chosen = kind if rng.random() < 0.75 else other
                if sign > 0 and stop and stop[0] - 2.0 < x < stop[1] + 2.0:
                    continue
                at = layout.at(x, kerb + sign * 1.15)
                plants.add_tree(mesh, *at[:2], scene.road.kerb_height_m, chosen, rng)
                hulls.append((*at, 0.16, 0.16))
    return hulls


def add_lamps(
    mesh: MeshBuilder, scene: Scene, layout: Layout
) -> tuple[list[np.ndarray], list[Hull]]:
    """Street lamps; world x, y of the luminaires of the right and the left row [n, 2]; hulls."""
    spacing, height = scene.furniture.lamp_spacing_m, scene.furniture.lamp_height_m
    rows = []
    hulls: list[Hull] = []
    for (kerb, _, sign), shift in zip(layout.rows(), (0.0, 0.5), strict=True):
        y = kerb + sign * 0.6
        first = layout.start + 9.0 + shift * spacing
        heads = []
        for x in np.arange(first, layout.end, spacing):
            heads.append(layout.at(x, y - sign * 1.9)[:2])
            if any(abs(x - centre) < layout.half_side + 0.3 for centre in layout.sides):
                continue  # it would stand in the roadway; choose the spacing so that none does
            with mesh.place(*layout.at(x, y, 0.0 if sign > 0 else np.pi)):
                pieces.add_lamp(mesh, height)
            hulls.append((*layout.at(x, y), 0.1, 0.1))
        rows.append(np.array(heads).reshape(-1, 2))
    return rows, hulls


def add_signs(
    mesh: MeshBuilder, scene: Scene, layout: Layout, first: int
) -> tuple[int, list[Hull]]:
    """Traffic signs and lights; signs are instances from ``first`` on.

    Returns:
        The number of signs, and the hulls of all poles.
    """
    z = scene.road.kerb_height_m
    hulls: list[Hull] = []
    count = 0

    def put(x: float, y: float, yaw: float, plate: signs.Plate) -> None:
        nonlocal count
        with mesh.place(*layout.at(x, y, yaw), z_m=z):
            signs.add_sign(mesh, plate, first + count)
        count += 1
        hulls.append((*layout.at(x, y), 0.06, 0.06))

    for block in layout.blocks:
        for kerb, _, sign in layout.rows():
            y = kerb + sign * 0.45
            ahead = sign < 0  # traffic on this side drives to +x
            yaw = 0.0 if ahead else np.pi
            enter, leave = (block.start, block.end) if ahead else (block.end, block.start)
            way = 1.0 if ahead else -1.0
            opens, closes = (block.opens, block.closes) if ahead else (block.closes, block.opens)
            if opens:
                put(enter + way * 9.0, y, yaw, signs.speed_limit)
            if block.end - block.start > 80.0:
                put((block.start + block.end) / 2 + way * 7.3, y, yaw, signs.no_parking)
            if closes:
                put(leave - way * 4.6, y, yaw, signs.crossing)
                put(leave - way * 24.0, y, yaw, signs.priority)
                x = leave - way * 0.6
                with mesh.place(x, y, yaw, z_m=z):
                    signs.add_signal(mesh, green=True, arm_m=3.4)
                hulls.append((x, y, 0.0, 0.1, 0.1))
    for centre in layout.sides:
        _side_signs(mesh, layout, centre, put, hulls, z)
    return count, hulls


def _side_signs(
    mesh: MeshBuilder,
    layout: Layout,
    centre: float,
    put: Callable[[float, float, float, signs.Plate], None],
    hulls: list[Hull],
    z_m: float,
) -> None:
    """A red light and a sign for who comes out of a side street, and a sign for who enters."""
    for k, (kerb, wall, sign) in enumerate(layout.rows()):
        # Coming towards the street from +y one drives to -y and keeps to x < centre.
        x = centre - sign * (layout.half_side + 0.5)
        yaw = -np.pi / 2 if sign > 0 else np.pi / 2
        with mesh.place(x, kerb + sign * 0.8, yaw, z_m=z_m):
            signs.add_signal(mesh, green=False, arm_m=0.0)
        hulls.append((x, kerb + sign * 0.8, 0.0, 0.1, 0.1))
        put(x, wall + sign * 0.6, yaw, signs.stop if k == 0 else signs.give_way)
        exit_x = centre + sign * (layout.half_side + 0.5)
        put(exit_x, wall + sign * 2.0, yaw + np.pi, signs.speed_limit if k else signs.no_parking)


def add_pieces(mesh: MeshBuilder, scene: Scene, layout: Layout) -> list[Hull]:
    """Benches, bins, hydrants, bollards, tubs, cabinets and the bus shelter."""
    rng = generator(scene, 5)
    z = scene.road.kerb_height_m
    hulls: list[Hull] = []
    stop = bus_stop(layout)
    for block in layout.blocks:
        for kerb, wall, sign in layout.rows():
            _block_pieces(mesh, layout, (block, kerb, wall, sign), z, stop, rng, hulls)
    if stop is not None:
        x, y = (stop[0] + stop[1]) / 2, layout.kerb_left + 1.8
        with mesh.place(*layout.at(x, y), z_m=z):
            pieces.add_shelter(mesh)
        hulls.append((*layout.at(x, y), 2.2, 0.8))
    return hulls


def _block_pieces(
    mesh: MeshBuilder,
    layout: Layout,
    row: tuple[StreetBlock, float, float, float],
    z_m: float,
    stop: tuple[float, float] | None,
    rng: np.random.Generator,
    hulls: list[Hull],
) -> None:
    block, kerb, wall, sign = row
    facing = 0.0 if sign > 0 else np.pi

    def put(
        piece: Callable[[MeshBuilder], None], x: float, y: float, half: tuple[float, float]
    ) -> None:
        if sign > 0 and stop and stop[0] - 1.0 < x < stop[1] + 1.0:
            return
        with mesh.place(*layout.at(x, y, facing), z_m=z_m):
            piece(mesh)
        hulls.append((*layout.at(x, y), *half))

    for x in np.arange(block.start + 14.0 + rng.uniform(0, 8), block.end - 10.0, 29.0):
        put(pieces.add_bench, x, kerb + sign * 1.2, (0.9, 0.26))
        put(pieces.add_bin, x + 1.9, kerb + sign * 0.75, (0.26, 0.26))
    for x in np.arange(block.start + 18.0 + rng.uniform(0, 20), block.end - 8.0, 53.0):
        put(pieces.add_hydrant, x, kerb + sign * 0.55, (0.17, 0.17))
        put(pieces.add_cabinet, x + 6.0, wall - sign * 0.35, (0.48, 0.2))
    for x in np.arange(block.start + 6.0 + rng.uniform(0, 6), block.end - 5.0, 15.0):
        if rng.random() < 0.5:
            at = (float(x), wall - sign * 0.45)
            put(pieces.add_planter, *at, (0.34, 0.34))
            if not (sign > 0 and stop and stop[0] - 1.0 < x < stop[1] + 1.0):
                plants.add_shrub(mesh, *layout.at(*at)[:2], z_m + 0.4, rng)
    for edge, way, there in ((block.start, 1.0, block.opens), (block.end, -1.0, block.closes)):
        if there:  # bollards round the corner, clear of the crossings
            for k in range(3):
                put(
                    pieces.add_bollard,
                    edge + way * (4.5 + 1.3 * k),
                    kerb + sign * 0.42,
                    (0.06, 0.06),
                )
            for k in range(2):
                x = edge + way * 0.45
                put(
                    pieces.add_bollard,
                    x,
                    kerb + sign * (4.6 + 1.3 * k - SIDE_WALK_M * 0.2),
                    (0.06, 0.06),
                )
