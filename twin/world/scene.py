"""Scene files: what a world is made of, as people write it; docs/scene.md explains them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from msgspec import Meta, field
from msgspec.structs import replace

from schemas.files.assets import ROAD_SUFFIX, is_path
from schemas.files.yaml_file import load_yaml
from schemas.validation import convert_all
from twin.road.lane import LanePath, straight
from twin.world.circuit import SEGMENTS_MAX, Segment, closed_lane
from twin.world.content import (
    DRIVABLE,
    MESHES_MAX,
    OBJECTS_MAX,
    MeshFile,
    SceneObject,
    Terrain,
)
from twin.world.scenery import RoadScenery
from twin.world.spec import Length, Position, Range, Share, Spec

_SCENES = Path(__file__).parent / "scenes"
_ROADS = Path(__file__).parents[1] / "road/shipped"

T = TypeVar("T")


_END_M = 340.0


class Road(Spec):
    """A street; the ego's lane begins on the x axis towards +x, oncoming traffic is left of it.

    Without ``path`` it is straight, and the lane's centre is y = 0. With it, ``x`` of what is said
    of the street counts along the lane's centre from ``start_m`` on, and ``y`` to the left of it.
    """

    start_m: Position = -70.0
    """Beginning of the street, world x [m]."""
    end_m: Position = _END_M
    """Place where a building closes a straight street, world x [m]."""
    path: Annotated[list[Segment], Meta(max_length=SEGMENTS_MAX)] = field(default_factory=list)
    """Straights and curves of a closed road, in the direction of travel."""
    lane_width_m: Length = 3.5
    parking_width_m: Length = 2.2
    """Strip for parked cars on either side [m]."""
    sidewalk_width_m: Length = 4.2
    kerb_height_m: Annotated[float, Meta(ge=0, le=0.5)] = 0.14
    cross_streets_m: list[Position] = field(default_factory=list)
    """Centres of side streets, world x [m]; each has zebra crossings before and behind."""
    cross_street_width_m: Length = 11.0

    def __post_init__(self) -> None:
        if not self.path:
            if self.end_m <= self.start_m:
                raise ValueError(f"end_m {self.end_m:g} must lie behind start_m {self.start_m:g}")
            return
        if self.cross_streets_m:
            raise ValueError("cross_streets_m: a road with a path has no side streets; leave it []")
        if self.end_m != _END_M:
            raise ValueError("end_m: a road with a path ends where it begins; leave end_m away")
        self.lane()

    def lane(self) -> LanePath:
        """The centre line of the ego's lane."""
        if not self.path:
            return straight(self.start_m, self.end_m)
        lane, parking, walk = self.lane_width_m, self.parking_width_m, self.sidewalk_width_m
        return closed_lane(self.start_m, self.path, 1.5 * lane + parking + walk)


class Buildings(Spec):
    """Rows of buildings behind the sidewalks."""

    width_m: Range = field(default_factory=lambda: [11.0, 24.0])
    """Smallest and largest width along the street [m]."""
    height_m: Range = field(default_factory=lambda: [9.0, 30.0])
    """Smallest and largest height [m]."""
    depth_m: Length = 14.0


class Furniture(Spec):
    """What stands on the sidewalks and at the kerbs."""

    tree_spacing_m: Length = 17.0
    lamp_spacing_m: Length = 26.0
    lamp_height_m: Length = 7.5
    lamp_intensity_cd: Annotated[float, Meta(ge=0, le=100_000)] = 2000.0
    """Luminous intensity of one street lamp; 2000 is a luminaire of about 6000 lm [cd]."""
    parked_cars: Share = 0.5
    """Share of the parking places that are taken [-]."""


class Obstacle(Spec):
    """The broken-down car in the ego's lane, standing along the street."""

    x_m: Position
    """Place of its rear bumper, world x; on a road with a path, along the lane [m]."""
    y_m: Annotated[float, Meta(ge=-3.5, le=0.8)] = 0.0
    """Place to the left of the lane's centre; about -2.9 is the strip of parked cars beside it
    [m]."""
    color: Annotated[list[Share], Meta(min_length=3, max_length=3)] = field(
        default_factory=lambda: [0.5, 0.05, 0.04]
    )
    """Linear RGB reflectance [-]."""
    hazard_lights: bool = False
    """Whether its hazard lamps blink; false: its battery is dead."""


class Origin(Spec):
    """Place of the world's origin on the Earth (WGS-84), and direction of its x axis."""

    latitude_deg: Annotated[float, Meta(ge=-89.9, le=89.9)] = 0.0
    longitude_deg: Annotated[float, Meta(ge=-180, le=180)] = 0.0
    altitude_m: Annotated[float, Meta(ge=-500, le=9000)] = 0.0
    """Above the ellipsoid [m]."""
    heading_deg: Annotated[float, Meta(ge=0, lt=360)] = 90.0
    """Direction of world +x, clockwise from north; 90: x is east, y north [deg]."""
    utc_offset_h: Annotated[float, Meta(ge=-12, le=14)] | None = None
    """Local time minus UTC [h]; null: the time zone of the longitude."""


class Scene(Spec, kw_only=True):
    """One scene file."""

    schema: Literal[1] = 1
    scene: str
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0
    """Seed of the generated street; has nothing to do with a case's seed."""
    street: bool = True
    """Generate the street of ``road``, ``buildings`` and ``furniture``; false: the world is made of
    ``terrain`` and ``meshes`` alone."""
    bake: bool = True
    """Work out how much of the sky every place sees (ambient occlusion), once."""
    obstacle: Obstacle | None = None
    """The broken-down car; left out: nothing stands in the lane, and cases have no DTC."""
    origin: Origin = Origin()
    road: Road = Road()
    buildings: Buildings = Buildings()
    furniture: Furniture = Furniture()
    objects: Annotated[list[SceneObject], Meta(max_length=OBJECTS_MAX)] = field(
        default_factory=list
    )
    """What moves by a script."""
    meshes: Annotated[list[MeshFile], Meta(max_length=MESHES_MAX)] = field(default_factory=list)
    """Own meshes."""
    terrain: Terrain | None = None
    """A heightfield."""
    opendrive: str = ""
    """OpenDRIVE file of roads, relative to the scene file; needs ``street: false``."""
    scenery: RoadScenery | None = None
    """Generated houses and trees, and street lamps, beside the roads of ``opendrive``."""

    def __post_init__(self) -> None:
        road = self.road
        if road.path and not self.street:
            raise ValueError("road.path needs the generated street; leave street: false away")
        if self.opendrive and self.street:
            raise ValueError("opendrive needs street: false, because its roads are the street")
        if self.opendrive and self.obstacle is not None:
            raise ValueError("opendrive: the obstacle stands on a generated street; leave it away")
        if self.scenery is not None and not self.opendrive:
            raise ValueError("scenery stands beside the roads of a file; name it in opendrive")
        if self.opendrive:
            pass
        elif not self.street:
            grounds = [mesh for mesh in self.meshes if mesh.semantic in DRIVABLE]
            level = self.terrain is not None and self.terrain.semantic in DRIVABLE
            if not level and not grounds:
                raise ValueError(
                    "street: false needs other ground: terrain, or a mesh with semantic "
                    f"{', '.join(DRIVABLE)}"
                )
        elif self.obstacle is None:
            pass
        elif road.path:
            end = road.start_m + road.lane().length_m
            if not road.start_m <= self.obstacle.x_m < end:
                raise ValueError(
                    f"obstacle.x_m {self.obstacle.x_m:g} must lie on the road, from "
                    f"{road.start_m:g} to {end:.1f} m along its lane"
                )
        elif not road.start_m + 200.0 <= self.obstacle.x_m <= road.end_m - 65.0:
            raise ValueError(
                f"obstacle.x_m {self.obstacle.x_m:g} must leave 200 m of street before it and 65 m "
                f"behind (road.start_m {road.start_m:g}, road.end_m {road.end_m:g})"
            )
        for name in ("width_m", "height_m"):
            low, high = getattr(self.buildings, name)
            if low > high:
                raise ValueError(f"buildings.{name}: smallest {low:g} above largest {high:g}")


def shipped_roads() -> dict[str, Path]:
    """OpenDRIVE files that come with the package, by name; each is a scene of its own."""
    return {path.stem: path for path in sorted(_ROADS.glob(f"*{ROAD_SUFFIX}"))}


def load_scene(name_or_path: str) -> Scene:
    """Load a shipped scene or road by name, or a scene or OpenDRIVE file by path.

    Files that the scene names are relative to the scene file; the result holds paths that can be
    opened.

    Raises:
        ValueError: no such scene, or a mistake in its file; one line.
    """
    roads = shipped_roads()
    if name_or_path in roads or name_or_path.endswith(ROAD_SUFFIX):
        road = roads.get(name_or_path, Path(name_or_path))
        return Scene(scene=road.stem, street=False, bake=False, opendrive=str(road))
    scene = load_named(name_or_path, Scene, _SCENES, "scene")
    folder = named_path(name_or_path, _SCENES, "scene").parent
    meshes = [replace(mesh, file=str(folder / mesh.file)) for mesh in scene.meshes]
    terrain = scene.terrain
    if terrain is not None:
        terrain = replace(terrain, heightmap=str(folder / terrain.heightmap))
    opendrive = str(folder / scene.opendrive) if scene.opendrive else ""
    if folder == _SCENES:
        opendrive = os.path.normpath(opendrive) if opendrive else ""  # as shipped roads are named
    return replace(scene, meshes=meshes, terrain=terrain, opendrive=opendrive)


def named_path(name_or_path: str, folder: Path, noun: str) -> Path:
    """The file that a name or a path stands for.

    Raises:
        ValueError: no such name is shipped.
    """
    if is_path(name_or_path):
        return Path(name_or_path)
    path = folder / f"{name_or_path}.yaml"
    if not path.is_file():
        stems = [file.stem for file in folder.glob("*.yaml")]
        shipped = ", ".join(sorted([*stems, *(shipped_roads() if folder == _SCENES else ())]))
        raise ValueError(
            f"{noun} '{name_or_path}': not shipped; give one of {shipped}, or the path of a file"
        )
    return path


def load_named(name_or_path: str, type_: type[T], folder: Path, noun: str) -> T:
    """Load a YAML file of ``type_`` from ``folder`` by name, or from anywhere by path.

    Raises:
        ValueError: not found, not YAML or a mistake in it; one line that names the place.
    """
    path = named_path(name_or_path, folder, noun)
    value, mistakes = convert_all(load_yaml(path), type_)
    if value is None:
        more = f" (and {len(mistakes) - 1} more)" if len(mistakes) > 1 else ""
        raise ValueError(mistakes[0].line(str(path)) + more)
    return value
