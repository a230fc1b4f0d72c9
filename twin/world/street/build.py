"""A scene file -> the world: one static mesh, colliders, object instances and a script."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec
import numpy as np

from schemas.files.assets import file_digest
from schemas.messages import OBJECT_CLASSES
from twin.actors.motion import Motion, ObjectKind, Still
from twin.actors.objects import Cast, build_cast
from twin.actors.palette import BodyRoom, build_palette
from twin.road.lane import LanePath, straight
from twin.world.kept import kept
from twin.world.meshes.details import FaceLook, Mask
from twin.world.meshes.imports import add_imports
from twin.world.meshes.kept_files import kept_files
from twin.world.meshes.mesh import Mesh, MeshBuilder
from twin.world.road_scene import add_roads, road_lane
from twin.world.roadside.roadside import add_roadside
from twin.world.scene import Scene
from twin.world.street import sidewalks
from twin.world.street.ambient import baked
from twin.world.street.bends import add_bends
from twin.world.street.buildings import add_buildings
from twin.world.street.ground import add_ground
from twin.world.street.layout import Hull, Layout, lay_out
from twin.world.street.parking import add_obstacle, add_parked
from twin.world.things import Thing, named, numbered

OBSTACLE = "obstacle"
"""Name of the broken-down car among the things of a world."""
_NO_LAMPS = (0.0, -1.0e6)
"""Lamps of a world without a street: so far away that they light nothing."""


@dataclass(frozen=True, slots=True)
class World:
    """Everything of a scene that does not change."""

    mesh: Mesh
    colliders: np.ndarray
    """float64 [K, 5]: centre x, y [m], yaw [rad], half length and width [m]; the obstacle first, if
    there is one."""
    instances: int
    """Number of static objects the box sensor reports: an obstacle, then the other vehicles, then
    signs and the like."""
    lamps_right: tuple[float, float]
    """World x of one right-hand lamp and world y of the row [m]."""
    lamps_left: tuple[float, float]
    """World x of one left-hand lamp and world y of the row [m]."""
    lamps: np.ndarray | None = None
    """World x, y of the street lamps of a road that bends, float64 [L, 2] [m]; None: the rows."""
    lane: LanePath = field(default_factory=lambda: straight(0.0, 1.0))
    """Centre line of the ego's lane."""
    lane_known: bool = True
    """There is a lane, of a street or a road; False: it says where an ego starts, and no more."""
    lane_start_z_m: float = 0.0
    """Height at which the lane begins [m]."""
    kinds: tuple[ObjectKind, ...] = ()
    """Meshes of movable objects."""
    motion: Motion = field(default_factory=Still)
    """Places of the movable objects."""
    textures: tuple[np.ndarray, ...] = ()
    """Images uint8 [h, w, 3], sRGB; those that only differ in their kind share the array."""
    texture_kinds: tuple[int, ...] = ()
    """What each image does beyond its borders and what its bytes are, see
    :func:`twin.world.meshes.details.texture_kind`; empty: all repeat."""
    masks: tuple[Mask, ...] = ()
    """Images with holes."""
    looks: tuple[FaceLook, ...] = ()
    """Materials from files that say more than a colour and an image."""
    static_classes: tuple[int, ...] = ()
    """Class of each static instance, index into :data:`schemas.messages.OBJECT_CLASSES`; by default
    all are cars."""
    mover_classes: tuple[int, ...] = ()
    """Class of each movable object; of those that are another thing in every slot, M of each class
    in turn (:attr:`twin.actors.motion.Placement.class_index`)."""
    has_obstacle: bool = True
    """The first collider is the broken-down car."""
    cars: int = 0
    """Number of the first colliders that are vehicles; instance i is the object of collider i."""
    things: tuple[Thing, ...] = ()
    """What the hulls belong to: one entry per collider, then one per movable object."""
    signals: tuple[str, ...] = ()
    """Traffic lights whose lamps a scenario switches, by their ids in the road file; faces of
    :data:`twin.world.meshes.materials.SIGNAL_LAMP` say by their tag which they are."""
    notes: tuple[str, ...] = ()
    """What was left out or made smaller when files were imported, one line each."""

    key: bytes = b""
    """Everything it was built from, beside the software; empty: files of its own as well."""

    @property
    def first_mover(self) -> int:
        """Instance of the first movable object; the static ones come before."""
        return self.instances

    @property
    def classes(self) -> np.ndarray:
        """int32 [I]: class of every instance."""
        static = self.static_classes or (0,) * self.instances
        return np.array([*static, *self.mover_classes], np.int32)

    @property
    def obstacle(self) -> int | None:
        """Collider of the broken-down car; None: there is none."""
        return 0 if self.has_obstacle else None

    def collider_of(self, name: str) -> int | None:
        """Collider of what a scenario names as its target: ``obstacle``, or the first hull of a
        thing that stands in the scene; None: it is not there."""
        if name == OBSTACLE:
            return self.obstacle
        names = (thing.name for thing in self.things[: len(self.colliders)])
        return next((index for index, found in enumerate(names) if found == name), None)

    @property
    def obstacle_rear_m(self) -> float:
        """World x of the obstacle's rear bumper [m]."""
        return float(self.colliders[0, 0] - self.colliders[0, 3])


def build_world(scene: Scene, bodies: int = 0) -> World:
    """Build the world of ``scene``; the same files give the same arrays. Do not write to them.

    A scene without files of its own is built once and kept on disk (:mod:`twin.world.kept`); of
    others, what their files hold is.

    Args:
        scene: the scene.
        bodies: room for so many bodies that a scenario brings, see :mod:`twin.actors.palette`.

    Raises:
        ValueError: a file or an object of the scene that cannot be used; one line.
    """
    if scene.meshes or scene.terrain:
        return _build(scene, bodies)
    key = msgspec.json.encode(scene) + (b"%d" % bodies if bodies else b"")
    if scene.opendrive:
        key += _content(scene.opendrive)
    if key not in _built:
        _built.clear()  # one is enough, and they are large
        world = kept("worlds", key, lambda: _build(scene, bodies))
        _built[key] = replace(world, key=key)
    return _built[key]


_built: dict[bytes, World] = {}


def _content(file: str) -> bytes:
    """The digest of a file of a scene.

    Raises:
        ValueError: it cannot be read; one line.
    """
    try:
        return file_digest(Path(file)).encode()
    except OSError as error:
        raise ValueError(f"{file}: {error.strerror or error}") from None


@dataclass(slots=True)
class _Parts:
    """What a world is made of besides faces."""

    cars: list[Hull]
    classes: list[str]
    things: list[Thing]
    lane: LanePath
    lane_known: bool
    lane_start_z_m: float = 0.0
    others: list[Hull] = field(default_factory=list)
    lamps_right: tuple[float, float] = _NO_LAMPS
    lamps_left: tuple[float, float] = _NO_LAMPS
    lamps: np.ndarray | None = None
    signals: tuple[str, ...] = ()


def _build(scene: Scene, bodies: int = 0) -> World:
    files = kept_files(scene)  # first: a file that cannot be used is refused at once
    mesh = MeshBuilder()
    layout = lay_out(scene)
    cars: list[Hull] = add_obstacle(mesh, scene, layout)
    things = [Thing(OBSTACLE, "car")] * len(cars)
    parts = _Parts(cars, ["car"] * len(cars), things, layout.lane, scene.street)
    if scene.street:
        _add_street(mesh, scene, layout, parts)
    if scene.opendrive:
        _add_roads(mesh, scene, parts)
    imported = add_imports(mesh, scene, len(parts.classes), files)
    classes = parts.classes + imported.classes
    solid = [item for item in scene.meshes if item.solid]
    things = [named(Path(m.file).stem, m.object_class or m.semantic) for m in solid]
    cast = _cast(scene, bodies)
    meshes = [mesh.build(), *(kind.mesh for kind in cast.kinds)]
    if scene.bake:
        meshes = baked(meshes)
    kinds = zip(cast.kinds, meshes[1:], strict=True)
    colliders = parts.cars + parts.others + imported.hulls
    return World(
        mesh=meshes[0],
        colliders=np.array(colliders, float).reshape(-1, 5),
        instances=len(classes),
        lamps_right=parts.lamps_right,
        lamps_left=parts.lamps_left,
        lamps=parts.lamps,
        lane=parts.lane,
        lane_known=parts.lane_known,
        lane_start_z_m=parts.lane_start_z_m,
        kinds=tuple(replace(kind, mesh=own) for kind, own in kinds),
        motion=cast.motion,
        textures=imported.textures,
        texture_kinds=imported.kinds,
        masks=imported.masks,
        looks=imported.looks,
        static_classes=tuple(OBJECT_CLASSES.index(name) for name in classes),
        mover_classes=cast.classes,
        has_obstacle=scene.obstacle is not None,
        cars=len(parts.cars),
        things=(*parts.things, *things, *cast.things),
        notes=imported.notes,
        signals=parts.signals,
    )


def _add_street(mesh: MeshBuilder, scene: Scene, layout: Layout, parts: _Parts) -> None:
    """Add the generated street of a scene."""
    stop = sidewalks.bus_stop(layout)
    add_ground(mesh, scene, layout)
    free = [(*stop, 1.0)] if stop else []
    parked, sorts = add_parked(mesh, scene, layout, len(parts.cars), free)
    parts.cars += parked
    parts.classes += sorts
    parts.things += [Thing(f"parked {body} {n}", body) for n, body in enumerate(sorts, start=1)]
    houses = [*add_buildings(mesh, scene, layout), *add_bends(mesh, scene, layout)]
    trees = sidewalks.add_trees(mesh, scene, layout)
    lamps, posts = sidewalks.add_lamps(mesh, scene, layout)
    if layout.lane.closed:
        parts.lamps = np.concatenate(lamps)
    else:
        parts.lamps_right, parts.lamps_left = (
            tuple(row[0].tolist()) if len(row) else _NO_LAMPS for row in lamps
        )
    signs, poles = sidewalks.add_signs(mesh, scene, layout, len(parts.classes))
    parts.classes += ["traffic_sign"] * signs
    pieces = sidewalks.add_pieces(mesh, scene, layout)
    parts.others += [*houses, *trees, *posts, *poles, *pieces]
    parts.things += numbered("building", "building", len(houses))
    parts.things += numbered("tree", "vegetation", len(trees))
    parts.things += numbered("street lamp", "pole", len(posts))
    parts.things += numbered("sign", "traffic_sign", len(poles))
    parts.things += numbered("street furniture", "pole", len(pieces))


def _add_roads(mesh: MeshBuilder, scene: Scene, parts: _Parts) -> None:
    """Add the roads of a file and what stands beside them."""
    add_roads(mesh, scene.opendrive)
    lane = road_lane(scene.opendrive)
    parts.lane, parts.lane_known = lane.path, True
    parts.lane_start_z_m = float(lane.course.z_m[0])
    beside = add_roadside(mesh, scene, len(parts.classes))
    parts.classes += ["traffic_sign"] * beside.plates
    parts.others += beside.hulls
    parts.things += beside.things
    parts.signals = beside.signals
    parts.lamps = beside.lamps_m


def _cast(scene: Scene, bodies: int) -> Cast:
    """Take up what may move in a scene.

    Raises:
        ValueError: the scene's objects cannot be; one line.
    """
    if not bodies:
        return build_cast(scene.objects)
    if scene.objects:
        raise ValueError(
            f"scene {scene.scene}: its objects would move beside those of the scenario; remove them"
        )
    classes = np.repeat(np.arange(len(OBJECT_CLASSES)), bodies)
    things = [Thing(f"body {number}", "car") for number in range(1, bodies + 1)]
    return Cast(build_palette().kinds, BodyRoom(bodies), tuple(classes.tolist()), tuple(things))
