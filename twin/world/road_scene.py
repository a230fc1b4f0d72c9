"""Worlds of OpenDRIVE roads: the faces of a file's roads, and the lane of their ego."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from schemas.files.assets import asset_digest
from twin.road.lane import LanePath
from twin.road.lane_fit import LanePoints, fit_lane
from twin.road.opendrive.lane_course import LaneCourse, lane_course
from twin.road.opendrive.lane_graph import DrivenLane, LaneKey, lane_graph
from twin.road.opendrive.road_frame import traffic_sign
from twin.road.opendrive.road_map import RoadMap
from twin.road.shipped.library import roads_of
from twin.road.surface.patch import SurfacePatch
from twin.road.surface.surface import road_surface
from twin.world.meshes import materials
from twin.world.meshes.mesh import DECAL, Color, MeshBuilder

EXTENT_MAX_M = 16_000
"""Farthest that a road may lie from the world's origin: places of meshes are float32 [m]."""

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


@dataclass(frozen=True, slots=True)
class EgoLane:
    """The lane of the ego on the roads of a file."""

    path: LanePath
    """Its middle, in plan; within 1 mm of the file's."""
    course: LaneCourse
    """Places along it, with heights and widths."""

    def heights_m(self, places: np.ndarray) -> list[float]:
        """Heights of places on the lane, x and y of each in [n, 2] or more [m]; empty: all of the
        lane lies at 0."""
        if not self.course.z_m.any():
            return []
        known = self.path.locate(self.course.x_m, self.course.y_m).s_m
        wanted = self.path.locate(places[:, 0], places[:, 1]).s_m
        heights: list[float] = np.interp(wanted, known, self.course.z_m).tolist()
        return heights


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


def road_lane(file: str) -> EgoLane:
    """The lane that an ego without another place starts on, as far as it leads.

    It is the rightmost driving lane of the first road that has one, from the beginning of that
    road in the direction of travel on.

    Raises:
        ValueError: there is no driving lane; one line.
    """
    return _kept_lane(file, asset_digest(Path(file)))


@lru_cache(maxsize=4)
def _kept_lane(file: str, _digest: str) -> EgoLane:
    """The same, once for every content of a file."""
    roads = road_map(file)
    course = lane_course(roads, lane_graph(roads.network), _first_lane(roads, file))
    path = fit_lane(LanePoints(course.x_m, course.y_m, course.heading_rad), closed=course.closed)
    return EgoLane(path, course)


def _first_lane(roads: RoadMap, file: str) -> DrivenLane:
    for frame in roads.frames.values():
        last = len(frame.sections) - 1
        for sign, index in ((1, 0), (-1, last)):
            section = frame.sections[index].section
            lanes = [lane for lane in section.lanes if lane.type == "driving"]
            ids = [lane.id for lane in lanes if traffic_sign(frame.road, lane) in (sign, 0)]
            if ids:
                right = sign > 0 and min(ids) < 0
                outer = min(ids) if right else max(ids, key=abs)
                return DrivenLane(LaneKey(frame.road.id, index, outer), sign)
    raise ValueError(f"{file}: it has no driving lane")
