"""What stands beside the roads of a scene: objects and signals of their file, and scenery."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import msgspec
import numpy as np

from schemas.files.assets import asset_digest
from twin.world.meshes.mesh import MeshBuilder
from twin.world.road_scene import road_lane, road_map, surface_of
from twin.world.roadside.lamp_rows import add_lamp_rows
from twin.world.roadside.objects import add_objects
from twin.world.roadside.scenery import add_scenery
from twin.world.roadside.signals import add_signals
from twin.world.scene import Scene
from twin.world.street.layout import Hull
from twin.world.things import Thing

HULLS_MAX = 20_000
"""Most rectangles beside the roads of a scene that vehicles collide with."""
LAMPS_EXTENT_MAX = 160_000_000
"""Most street lamps times the ground around them that is lit [m^2]."""
LAMPS_MARGIN_M = 80.0
"""How far the ground around lamps goes on in each direction, both sides together [m]."""


@dataclass(frozen=True, slots=True)
class Roadside:
    """What stands beside the roads of a scene."""

    hulls: tuple[Hull, ...]
    things: tuple[Thing, ...]
    """One per hull."""
    plates: int
    """Instances of class ``traffic_sign``."""
    signals: tuple[str, ...]
    """Ids of the signals with lamps, see :attr:`twin.world.street.build.World.signals`."""
    lamps_m: np.ndarray | None
    """World x, y of street lamps that light the ground, float64 [L, 2]; None: there are none, or
    too many on too much ground."""


def add_roadside(mesh: MeshBuilder, scene: Scene, first_instance: int) -> Roadside:
    """Add objects and signals of a scene's road file, and the scenery of the scene.

    Args:
        mesh: receives their faces.
        scene: the scene.
        first_instance: number of the first traffic sign.

    Raises:
        ValueError: there is too much, or scenery for a road that does not exist; one line.
    """
    roads = road_map(scene.opendrive)
    rows = [add_objects(mesh, roads)]
    signals = add_signals(mesh, roads, first_instance)
    rows.append(signals.standing)
    if scene.scenery is not None:
        rows.append(
            add_scenery(mesh, roads, surface_of(scene.opendrive), scene.scenery, scene.seed)
        )
        height_m = scene.furniture.lamp_height_m
        rows.append(add_lamp_rows(mesh, roads, scene.scenery.lamps, height_m))
    count = sum(len(row.hulls) for row in rows)
    if count > HULLS_MAX:
        raise ValueError(
            f"{scene.opendrive}: {count} solid pieces beside its roads, at most {HULLS_MAX} can be "
            "hit; use a part of it"
        )
    return Roadside(
        tuple(hull for row in rows for hull in row.hulls),
        tuple(thing for row in rows for thing in row.things),
        signals.plates,
        tuple(signals.lights),
        _shining([at for row in rows for at in row.lamps_m]),
    )


def _shining(lamps_m: list[tuple[float, float]]) -> np.ndarray | None:
    """Street lamps whose table of the nearest ones stays small."""
    at = np.array(lamps_m).reshape(-1, 2)
    if not len(at):
        return None
    extent = float((np.ptp(at, axis=0) + LAMPS_MARGIN_M).prod())
    return at if extent * len(at) <= LAMPS_EXTENT_MAX else None


def road_mistake(scene: Scene) -> str:
    """Why the roads of a scene cannot be a world, or an empty string."""
    try:
        return _mistake(asset_digest(Path(scene.opendrive)), msgspec.json.encode(scene))
    except ValueError as error:
        return str(error)


@lru_cache(maxsize=64)
def _mistake(_digest: str, encoded: bytes) -> str:
    """Mistake of a scene as JSON, found once for every content of its file: many cases have the
    same one."""
    scene = msgspec.json.decode(encoded, type=Scene)
    try:
        surface_of(scene.opendrive)
        road_lane(scene.opendrive)
        add_roadside(MeshBuilder(), scene, 0)
    except ValueError as error:
        return str(error)
    return ""
