"""Generated houses and trees beside the roads of a file, where the ground is free."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twin.road.opendrive.grid import angle_of, cosine, sine
from twin.road.opendrive.road_frame import RoadFrame
from twin.road.opendrive.road_map import RoadMap
from twin.road.surface.patch import SurfacePatch
from twin.world.meshes import materials
from twin.world.meshes.mesh import Color, MeshBuilder
from twin.world.roadside.free_ground import FreeGround
from twin.world.roadside.objects import RoadsideHulls, check_points
from twin.world.scenery import HouseRow, LampRow, RoadScenery, TreeRow
from twin.world.street.buildings import add_building
from twin.world.street.plants import KINDS, add_tree

HOUSES_MAX, TREES_MAX = 2_000, 10_000
"""Most places for houses and for trees in a scene."""
_BASEMENT_M = 3.0
_CLEAR_M = 1.0
"""Between a house and what stands or drives beside it [m]."""
_TRUNK_M = 0.2
_STONE: Color = (0.26, 0.25, 0.24)


class _Place(NamedTuple):
    """A place beside a road."""

    x_m: float
    y_m: float
    z_m: float
    out: tuple[float, float]
    """Unit direction away from the road, in the plane."""


class _Stretch(NamedTuple):
    """A row along one side of one road."""

    row: HouseRow | TreeRow
    frame: RoadFrame
    side: float
    """1 to the left, -1 to the right."""
    end_m: float
    key: tuple[int, int, int]
    """Of its random numbers."""


def add_scenery(
    mesh: MeshBuilder,
    roads: RoadMap,
    patches: tuple[SurfacePatch, ...],
    scenery: RoadScenery,
    seed: int,
) -> RoadsideHulls:
    """Add the scenery of a scene file; the hulls of what stands there.

    Args:
        mesh: receives it.
        roads: the roads.
        patches: their surface.
        scenery: what to generate.
        seed: of the scene.

    Raises:
        ValueError: a row names a road that does not exist, or there is too much; one line.
    """
    standing, ground = (RoadsideHulls(), RoadsideHulls()), FreeGround(patches)
    houses = list(_stretches(roads, scenery.houses, "houses"))
    trees = list(_stretches(roads, scenery.trees, "trees"))
    for stretches, most, name in ((houses, HOUSES_MAX, "houses"), (trees, TREES_MAX, "trees")):
        count = sum(_places(stretch) for stretch in stretches)
        if count > most:
            raise ValueError(f"scenery.{name}: {count} places, at most {most}; use fewer")
    for kind, stretches in enumerate((houses, trees)):
        for stretch in stretches:
            rng = np.random.default_rng([seed, kind, *stretch.key])
            if isinstance(stretch.row, HouseRow):
                _add_houses(mesh, stretch, stretch.row, rng, ground, standing[kind])
            else:
                _add_trees(mesh, stretch, stretch.row, rng, ground, standing[kind])
            check_points(mesh, roads.network.file)
    first, second = standing
    return RoadsideHulls([*first.hulls, *second.hulls], [*first.things, *second.things])


def _stretches(roads: RoadMap, rows: Sequence[HouseRow | TreeRow], name: str) -> Iterator[_Stretch]:
    for number, row in enumerate(rows):
        for road, frame in enumerate(frames_of(roads, row, f"{name}[{number}]")):
            end = frame.road.length_m if row.to_m is None else min(row.to_m, frame.road.length_m)
            if row.side != "right":
                yield _Stretch(row, frame, 1.0, end, (number, road, 1))
            if row.side != "left":
                yield _Stretch(row, frame, -1.0, end, (number, road, 0))


def _places(stretch: _Stretch) -> int:
    """The most that can stand along a stretch."""
    row, length = stretch.row, max(stretch.end_m - stretch.row.from_m, 0.0)
    if isinstance(row, HouseRow):
        return int(length / (row.width_m[0] + row.gap_m[0])) + 1
    return int(length / row.spacing_m) + 1


def frames_of(roads: RoadMap, row: HouseRow | TreeRow | LampRow, place: str) -> list[RoadFrame]:
    """The roads that a row of a scene file stands along.

    Raises:
        ValueError: there is no such road, or it ends before the row begins; one line.
    """
    if not row.road:
        return [frame for frame in roads.frames.values() if frame.road.junction is None]
    if row.road not in roads.frames:
        raise ValueError(f"scenery.{place}.road: {roads.network.file} has no road {row.road[:40]}")
    frame = roads.frames[row.road]
    if row.from_m >= frame.road.length_m:
        raise ValueError(
            f"scenery.{place}.from_m {row.from_m:g}: road {row.road[:40]} is "
            f"{frame.road.length_m:g} m long"
        )
    return [frame]


def _beside(frame: RoadFrame, s_m: float, side: float, offset_m: float) -> _Place:
    """The place ``offset_m`` outside of the outermost lane of a side."""
    at = np.array([s_m])
    section = frame.sections[int(frame.section_at(at)[0])]
    lanes = section.section.left if side > 0.0 else section.section.right
    edge = float(section.outer(lanes[-1].id if lanes else 0, at)[0][0])
    pose = frame.pose(s_m, edge)
    heading = float(frame.pose(s_m).heading_rad)
    out = -side * float(sine(heading)), side * float(cosine(heading))
    x, y = float(pose.x_m) + out[0] * offset_m, float(pose.y_m) + out[1] * offset_m
    return _Place(x, y, float(pose.z_m), out)


def _add_houses(
    mesh: MeshBuilder,
    stretch: _Stretch,
    row: HouseRow,
    rng: np.random.Generator,
    ground: FreeGround,
    standing: RoadsideHulls,
) -> None:
    for along, width, height in _plots(row, stretch.end_m, rng):
        place = _beside(stretch.frame, along, stretch.side, row.offset_m)
        # Seen from the road a front runs to the right; its back lies outwards.
        right = place.out[1], -place.out[0]
        if not ground.is_free(_plan(place, right, width, row.depth_m, _CLEAR_M)):
            continue
        yaw = float(angle_of(np.array(right[1]), np.array(right[0])))
        corner = (
            place.x_m - 0.5 * width * right[0],
            place.y_m - 0.5 * width * right[1],
            yaw,
        )
        size = width, row.depth_m, height
        with mesh.label("building"), mesh.place(0.0, 0.0, z_m=place.z_m):
            add_building(mesh, corner, size, (True, True), rng, relief=True)
            with mesh.place(*corner):
                low, high = (0.0, 0.0, -_BASEMENT_M), (width, row.depth_m, 0.0)
                mesh.box(low, high, materials.PLAIN, _STONE)
        ground.take(_plan(place, right, width, row.depth_m, 0.0))
        middle = [
            corner_m + 0.5 * row.depth_m * out
            for corner_m, out in zip((place.x_m, place.y_m), place.out, strict=True)
        ]
        hull = (middle[0], middle[1], yaw, 0.5 * width, 0.5 * row.depth_m)
        standing.add(f"house {len(standing.hulls) + 1}", "building", [hull])


def _plots(
    row: HouseRow, end: float, rng: np.random.Generator
) -> Iterator[tuple[float, float, float]]:
    """Station of the middle, width and height of the houses of a row."""
    s = row.from_m
    while True:
        width, height = rng.uniform(*row.width_m), rng.uniform(*row.height_m)
        gap, built = rng.uniform(*row.gap_m), rng.random() < row.share
        if s + width > end:
            return
        if built:
            yield s + 0.5 * width, width, height
        s += width + gap


def _plan(
    place: _Place, right: tuple[float, float], width: float, depth: float, clear: float
) -> np.ndarray:
    """Places on the ground of a house, half a metre apart [N, 2]."""
    along = np.linspace(-0.5 * width - clear, 0.5 * width + clear, int(2.0 * width) + 3)
    back = np.linspace(min(0.0, 0.4 - clear), depth + clear, int(2.0 * depth) + 3)
    a, b = (grid.ravel()[:, None] for grid in np.meshgrid(along, back, indexing="ij"))
    plan: np.ndarray = (place.x_m, place.y_m) + a * np.array(right) + b * np.array(place.out)
    return plan


def _add_trees(
    mesh: MeshBuilder,
    stretch: _Stretch,
    row: TreeRow,
    rng: np.random.Generator,
    ground: FreeGround,
    standing: RoadsideHulls,
) -> None:
    for s in np.arange(row.from_m, stretch.end_m + 1e-9, row.spacing_m).tolist():
        shift = rng.uniform(-row.jitter_m, row.jitter_m), rng.uniform(0.0, row.jitter_m)
        kind = KINDS[int(rng.integers(len(KINDS)))]
        height = rng.uniform(*row.height_m)
        turn = int(rng.integers(2**31))
        at = min(max(s + shift[0], 0.0), stretch.frame.road.length_m)
        place = _beside(stretch.frame, at, stretch.side, row.offset_m + shift[1])
        spot = np.array([(place.x_m, place.y_m)])
        if not ground.is_free(spot):
            continue
        shape = replace(kind, height_m=(height, height))
        rooted = place.x_m, place.y_m, place.z_m
        add_tree(mesh, *rooted, shape, np.random.default_rng(turn))
        hull = (place.x_m, place.y_m, 0.0, _TRUNK_M, _TRUNK_M)
        standing.add(f"tree {len(standing.hulls) + 1}", "vegetation", [hull])
