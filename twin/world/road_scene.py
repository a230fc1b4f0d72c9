"""Worlds of OpenDRIVE roads: the faces of a file's roads, and the lane of their ego."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from schemas.files.assets import asset_digest
from twin.road.lane import LanePath, Piece, trace
from twin.road.opendrive.road_frame import RoadFrame, traffic_sign
from twin.road.opendrive.road_map import RoadMap
from twin.road.shipped.library import roads_of
from twin.road.surface.patch import SurfacePatch
from twin.road.surface.surface import road_surface
from twin.world.meshes import materials
from twin.world.meshes.mesh import DECAL, Color, MeshBuilder

EXTENT_MAX_M = 16_000
"""Farthest that a road may lie from the world's origin: places of meshes are float32 [m]."""
_STRAIGHT_M = 0.02
"""A lane whose middle strays less from its chord is straight [m]."""
_STEP_M = 2.0

_ASPHALT: Color = (0.09, 0.09, 0.095)
_SHOULDER: Color = (0.115, 0.11, 0.105)
_CONCRETE: Color = (0.30, 0.29, 0.27)
_BIKING: Color = (0.20, 0.06, 0.045)
_GRASS: Color = (0.09, 0.13, 0.045)
_STONE: Color = (0.40, 0.40, 0.39)
_PAINT: Color = (0.70, 0.70, 0.67)

_LANES: dict[str, tuple[str, int, Color]] = {
    "sidewalk": ("sidewalk", materials.PAVING, _CONCRETE),
    "walking": ("sidewalk", materials.PAVING, _CONCRETE),
    "curb": ("sidewalk", materials.PLAIN, _STONE),
    "biking": ("road", materials.ASPHALT, _BIKING),
    "shoulder": ("road", materials.ASPHALT, _SHOULDER),
    "parking": ("road", materials.ASPHALT, _SHOULDER),
    "border": ("terrain", materials.GRASS, _GRASS),
    "median": ("terrain", materials.GRASS, _GRASS),
    "none": ("terrain", materials.GRASS, _GRASS),
}
"""Class, material and colour of lanes by type; all others are asphalt."""
_COLORS: dict[str, Color] = {
    "yellow": (0.62, 0.42, 0.04),
    "orange": (0.60, 0.22, 0.02),
    "red": (0.45, 0.03, 0.03),
    "blue": (0.04, 0.10, 0.42),
    "green": (0.04, 0.30, 0.08),
    "black": (0.02, 0.02, 0.02),
    "violet": (0.24, 0.05, 0.34),
}
"""Reflectance of marks by colour; all others are white."""


def road_map(file: str) -> RoadMap:
    """The roads of a file, with coordinates.

    Raises:
        ValueError: it cannot be used; one line.
    """
    return _kept(file, asset_digest(Path(file)))


@lru_cache(maxsize=4)
def _kept(file: str, _digest: str) -> RoadMap:
    """The same, once for every content of a file."""
    return RoadMap(roads_of(Path(file)))


def surface_of(file: str) -> tuple[SurfacePatch, ...]:
    """The surface of a file's roads.

    Raises:
        ValueError: it cannot be a world; one line.
    """
    return _kept_surface(file, asset_digest(Path(file)))


@lru_cache(maxsize=2)
def _kept_surface(file: str, digest: str) -> tuple[SurfacePatch, ...]:
    patches = road_surface(_kept(file, digest))
    reach = max(float(np.abs(patch.points_m[:, :2]).max()) for patch in patches)
    if reach > EXTENT_MAX_M:
        raise ValueError(
            f"{file}: its roads reach {reach:.0f} m from the origin, at most {EXTENT_MAX_M:g} m "
            "can be shown; move them (offset of the header)"
        )
    return patches


def add_roads(mesh: MeshBuilder, file: str) -> None:
    """Add the lanes, kerbs and marks of a file, and the ground around.

    Raises:
        ValueError: the file cannot be used; one line.
    """
    for patch in surface_of(file):
        semantic, material, color, tag = _look(patch)
        with mesh.label(semantic), mesh.rolled(patch.friction):
            mesh.add(patch.points_m, patch.faces, material, color, tag)


def _look(patch: SurfacePatch) -> tuple[str, int, Color, int]:
    """Class, material, colour and tag of a patch."""
    if patch.kind == "mark":
        return "marking", materials.PAINT, _COLORS.get(patch.look, _PAINT), DECAL
    if patch.kind == "kerb":
        return "sidewalk", materials.PLAIN, _STONE, 0
    if patch.kind == "ground":
        return "terrain", materials.GRASS, _GRASS, 0
    return *_LANES.get(patch.look, ("road", materials.ASPHALT, _ASPHALT)), 0


def road_lane(file: str) -> tuple[LanePath, bool]:
    """The lane that an ego without another place starts on, and whether all of it is known.

    It is the rightmost driving lane of the first road that has one. A straight one is known from
    its beginning to its end; of another there is its first metre, for a start pose.

    Raises:
        ValueError: there is no driving lane; one line.
    """
    for frame in road_map(file).frames.values():
        lanes = [lane for lane in frame.sections[0].section.lanes if lane.type == "driving"]
        along = [lane.id for lane in lanes if traffic_sign(frame.road, lane) >= 0]
        against = [lane.id for lane in lanes if traffic_sign(frame.road, lane) < 0]
        if along:
            return _lane_path(frame, min(along) if min(along) < 0 else max(along), 1.0)
        if against:
            return _lane_path(frame, max(against, key=abs), -1.0)
    raise ValueError(f"{file}: it has no driving lane")


def _lane_path(frame: RoadFrame, lane: int, sign: float) -> tuple[LanePath, bool]:
    end = np.nextafter(frame.sections[0].section.end_m, 0.0)
    s = np.linspace(0.0, end, max(2, int(end / _STEP_M) + 1))[:: int(sign)]
    pose = frame.lane_pose(lane, s, with_traffic=True)
    x, y, heading = (float(values[0]) for values in (pose.x_m, pose.y_m, pose.heading_rad))
    dx, dy = pose.x_m - x, pose.y_m - y
    length = float(np.hypot(dx[-1], dy[-1]))
    aside = np.abs(dx * dy[-1] - dy * dx[-1]) / max(length, 1e-9)
    level = float(np.abs(pose.z_m).max()) < _STRAIGHT_M
    known = level and length > 1.0 and float(aside.max()) < _STRAIGHT_M
    return trace((x, y, heading), [Piece(length if known else 1.0, 0.0)]), known
