"""A world that is a road network and the ground around it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from twin.road.opendrive.road_map import RoadMap
from twin.road.surface.patch import SurfacePatch
from twin.road.surface.surface import road_surface
from twin.world.meshes import materials
from twin.world.meshes.mesh import DECAL, Color, MeshBuilder
from twin.world.street.build import NO_LAMPS, World
from twin.world.street.ground import ASPHALT

_STONE: Color = (0.40, 0.40, 0.39)
_GRASS: Color = (0.09, 0.13, 0.045)
_LANES: dict[str, tuple[str, int, Color]] = {
    **dict.fromkeys(("sidewalk", "walking"), ("sidewalk", materials.PAVING, (0.30, 0.29, 0.27))),
    "curb": ("sidewalk", materials.PLAIN, _STONE),
    **dict.fromkeys(("median", "none"), ("terrain", materials.GRASS, _GRASS)),
}
"""Class, material and colour by type of lane; all others are asphalt."""
_PAINTS: dict[str, Color] = {
    "yellow": (0.72, 0.50, 0.06),
    "blue": (0.06, 0.18, 0.55),
    "red": (0.55, 0.06, 0.05),
    "green": (0.08, 0.38, 0.12),
    "orange": (0.70, 0.28, 0.05),
    "violet": (0.28, 0.10, 0.45),
    "black": (0.02, 0.02, 0.02),
}
"""Linear reflectance by colour of a mark; all others are white."""
_WHITE: Color = (0.70, 0.70, 0.67)


def road_world(roads: RoadMap) -> World:
    """The world of a road network, without anything that stands beside its roads.

    Raises:
        ValueError: its surface is too large; one line.
    """
    mesh = MeshBuilder()
    add_surface(mesh, road_surface(roads))
    return World(
        mesh=mesh.build(),
        colliders=np.zeros((0, 5)),
        instances=0,
        lamps_right=NO_LAMPS,
        lamps_left=NO_LAMPS,
        has_obstacle=False,
    )


def add_surface(mesh: MeshBuilder, surface: Iterable[SurfacePatch]) -> None:
    """Add the surface of roads; marks are decals, kerbs belong to the sidewalk."""
    for patch in surface:
        semantic, material, color, tag = _look(patch)
        with mesh.label(semantic):
            mesh.add(patch.points_m, patch.faces, material, color, tag)


def _look(patch: SurfacePatch) -> tuple[str, int, Color, int]:
    """Class, material, colour and tag."""
    if patch.kind == "mark":
        return "marking", materials.PAINT, _PAINTS.get(patch.look, _WHITE), DECAL
    if patch.kind == "kerb":
        return "sidewalk", materials.PLAIN, _STONE, 0
    if patch.kind == "ground":
        return "terrain", materials.GRASS, _GRASS, 0
    return (*_LANES.get(patch.look, ("road", materials.ASPHALT, ASPHALT)), 0)
