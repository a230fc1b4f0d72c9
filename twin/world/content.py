"""What scene files may add to a world: moving objects, own meshes, terrain."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from msgspec import Meta, field

from twin.world.spec import Length, Point, Position, Rgb, Spec

OBJECTS_MAX, MESHES_MAX = 64, 64
"""Most objects and most mesh files of a scene."""
WAYPOINTS_MAX = 200
"""Most waypoints of an object."""

Kind = Literal["pedestrian", "car", "van", "truck", "bus", "cyclist"]
Body = Literal["hatchback", "saloon", "suv"]
Semantic = Literal[
    "unlabelled", "road", "marking", "sidewalk", "building", "wall", "vegetation", "terrain",
    "pole", "lamp", "traffic_sign", "car", "truck", "bus", "pedestrian", "bicycle",
]  # fmt: skip
ObjectClass = Literal["car", "truck", "bus", "pedestrian", "bicycle", "traffic_sign"]
MaterialName = Literal[
    "plain", "asphalt", "paving", "paint", "facade", "shopfront", "foliage", "car_paint", "glass",
    "brick", "plaster", "sign", "grass",
]  # fmt: skip

DRIVABLE = ("road", "sidewalk", "terrain")
"""Semantic classes that wheels can stand on."""

Waypoint = Annotated[list[Position], Meta(min_length=2, max_length=3)]
Speed = Annotated[float, Meta(ge=0, le=60)]
Time = Annotated[float, Meta(ge=-3600, le=3600)]


def _origin() -> list[float]:
    return [0.0, 0.0, 0.0]


class SceneObject(Spec, kw_only=True):
    """An object that follows a script: a function of sim time alone."""

    kind: Kind
    name: str = ""
    """Name for messages; the kind and its number by default."""
    waypoints: Annotated[list[Waypoint], Meta(min_length=1, max_length=WAYPOINTS_MAX)]
    """Way on the ground: world x, y and, where the ground is not at 0, z [m]."""
    speed_mps: Annotated[float, Meta(gt=0, le=60)] | None = None
    """The same speed all the way [m/s]."""
    speeds_mps: list[Speed] | None = None
    """Speed at each waypoint, changing evenly in time between them [m/s]."""
    times_s: list[Time] | None = None
    """When it is at each waypoint, after ``start_s``, from 0 on [s]."""
    waits_s: list[Annotated[float, Meta(ge=0, le=3600)]] | None = None
    """Time that it stands at each waypoint; only where its speed there is 0 [s]."""
    start_s: Time = 0.0
    """Sim time at which it sets off; before, it stands at the first waypoint [s]."""
    loop: bool = False
    """Whether it goes on from the last waypoint to the first, round and round."""
    repeat_s: Annotated[float, Meta(gt=0, le=3600)] | None = None
    """Sets off anew every so many seconds, and stands at the end until then [s]."""
    present: Literal["always", "moving"] = "always"
    """``moving``: it is only there between its start and its end."""
    corner_m: Annotated[float, Meta(ge=0, le=100)] | None = None
    """Radius of the turns at waypoints; by default 5 for vehicles, 0.5 for people [m]."""
    yaw_deg: Annotated[float, Meta(ge=-360, le=360)] = 0.0
    """Heading of an object with a single waypoint, anticlockwise from +x [deg]."""
    seed: Annotated[int, Meta(ge=0, le=2**31 - 1)] = 0
    """Chooses its looks."""
    color: Rgb | None = None
    """Paint, or coat; by default the seed chooses."""
    body: Body = "saloon"
    """Body of a car."""

    def __post_init__(self) -> None:
        points = len(self.waypoints)
        laws = [n for n in ("speed_mps", "speeds_mps", "times_s") if getattr(self, n) is not None]
        if points == 1:
            if laws or self.loop or self.repeat_s is not None:
                raise ValueError("one waypoint: it stands there; leave speeds and times away")
            return
        if len(laws) != 1:
            given = " and ".join(laws) or "none"
            raise ValueError(f"give one of speed_mps, speeds_mps, times_s; given: {given}")
        if self.loop and self.repeat_s is not None:
            raise ValueError("loop and repeat_s: give one of them")
        self._check_lengths(points)

    def _check_lengths(self, points: int) -> None:
        stops = points + 1 if self.loop and self.times_s is not None else points
        for name, wanted in (("speeds_mps", points), ("times_s", stops), ("waits_s", points)):
            values = getattr(self, name)
            if values is not None and len(values) != wanted:
                more = " (one more for the way back)" if wanted > points else ""
                raise ValueError(
                    f"{name}: {len(values)} values for {points} waypoints, needed {wanted}{more}"
                )
        times = self.times_s
        if times is not None and (times[0] != 0.0 or any(b <= a for a, b in pairwise(times))):
            raise ValueError("times_s must begin with 0 and grow")
        speeds = self.speeds_mps
        if speeds is not None:
            pairs = list(zip(speeds, speeds[1:] + (speeds[:1] if self.loop else []), strict=False))
            if any(a == b == 0.0 for a, b in pairs):
                raise ValueError("speeds_mps: 0 at two waypoints in a row, it would never arrive")
        if self.waits_s is not None and any(self.waits_s):
            if speeds is None:
                raise ValueError("waits_s needs speeds_mps with 0 where it waits")
            if any(w > 0.0 and v > 0.0 for w, v in zip(self.waits_s, speeds, strict=True)):
                raise ValueError("waits_s: it can only wait where speeds_mps is 0")


class MeshFile(Spec, kw_only=True):
    """A mesh from a file, placed in the world."""

    file: str
    """glTF, GLB, OBJ, PLY or STL; relative to the scene file."""
    position_m: Point = field(default_factory=_origin)
    """Place of its origin."""
    rotation_deg: Annotated[
        list[Annotated[float, Meta(ge=-360, le=360)]], Meta(min_length=3, max_length=3)
    ] = field(default_factory=_origin)
    """Roll, pitch, yaw: turned about world x, then y, then z [deg]."""
    scale: Annotated[float, Meta(gt=0, le=10_000)] = 1.0
    """Metres per unit of the file."""
    up: Literal["y", "z"] | None = None
    """Axis of the file that points up; by default y for glTF and GLB, z for the others."""
    semantic: Semantic = "unlabelled"
    """Class of its pixels; road, sidewalk and terrain carry wheels."""
    material: MaterialName | None = None
    """Procedural surface; by default the colours and textures of the file."""
    color: Rgb | None = None
    """Colour of all faces; by default those of the file."""
    emission_cd_m2: Annotated[float, Meta(ge=0, le=1e6)] = 2000.0
    """Luminance of what emits 1 in the file: emissive factor times strength."""
    solid: bool = False
    """Vehicles collide with the rectangle around it."""
    object_class: ObjectClass | None = None
    """Makes it an object of the box sensor."""


class Terrain(Spec, kw_only=True):
    """Ground from a picture of heights: columns run to +x, the last row lies at the lowest y."""

    heightmap: str
    """PNG (8 or 16 bits, one channel) or NPY (two axes); relative to the scene file."""
    size_m: Annotated[list[Length], Meta(min_length=2, max_length=2)]
    """Extent along x and y [m]."""
    height_m: Annotated[float, Meta(gt=0, le=9000)] = 1.0
    """Height of the brightest PNG value above the darkest possible, or of the NPY value 1 [m]."""
    position_m: Point = field(default_factory=_origin)
    """Middle of the field, at the height 0 of the picture."""
    material: MaterialName = "grass"
    semantic: Semantic = "terrain"
    color: Rgb | None = None
