"""Objects of a scene file -> kinds with meshes, and the script that moves them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from schemas.messages import OBJECT_CLASSES
from twin.actors import car_body, heavy_body
from twin.actors.actor import Actor
from twin.actors.cyclist import LENGTH_M, WAY_M, WIDTH_M, add_cyclist
from twin.actors.motion import Motion, ObjectKind, Still
from twin.actors.path import Path, TimeLaw, build_path, law_of_speeds, law_of_times
from twin.actors.person import PHASES, add_person, random_looks
from twin.actors.script import MotionScript
from twin.world.content import SceneObject
from twin.world.meshes.mesh import Color, MeshBuilder
from twin.world.street.parking import PAINTS
from twin.world.things import Thing, named

_CLASS = {
    "pedestrian": "pedestrian",
    "car": "car",
    "van": "car",
    "truck": "truck",
    "bus": "bus",
    "cyclist": "bicycle",
}
_CORNER_M = {"pedestrian": 0.5, "cyclist": 2.5}
_VEHICLE_CORNER_M = 5.0
_BUS_COLOR: Color = (0.50, 0.36, 0.06)
_PERSON_HALF_M = 0.25


@dataclass(frozen=True, slots=True)
class Cast:
    """The movable objects of a world."""

    kinds: tuple[ObjectKind, ...]
    motion: Motion
    classes: tuple[int, ...]
    """Class of each object, index into :data:`schemas.messages.OBJECT_CLASSES`."""
    things: tuple[Thing, ...] = ()
    """Name of each object in messages."""


def build_cast(objects: list[SceneObject]) -> Cast:
    """Build the meshes and the script of a scene's objects.

    Raises:
        ValueError: a way or a law of time that cannot be; one line that names the object.
    """
    if not objects:
        return Cast((), Still(), ())
    kinds: list[ObjectKind] = []
    seen: dict[tuple, tuple[int, int, float]] = {}
    actors = []
    for number, item in enumerate(objects):
        color = None if item.color is None else tuple(item.color)
        looks = (item.kind, item.seed, color, item.body)
        if looks not in seen:
            own, phases, way = _kinds(item)
            seen[looks] = (len(kinds), phases, way)
            kinds += own
        actors.append(_checked_actor(number, item, *seen[looks]))
    classes = tuple(OBJECT_CLASSES.index(_CLASS[item.kind]) for item in objects)
    things = tuple(
        named(item.name or f"{item.kind} {number}", _CLASS[item.kind])
        for number, item in enumerate(objects)
    )
    return Cast(tuple(kinds), MotionScript(actors), classes, things)


def _checked_actor(number: int, item: SceneObject, kind: int, phases: int, way_m: float) -> Actor:
    try:
        return _actor(item, kind, phases, way_m)
    except ValueError as error:
        name = f" '{item.name}'" if item.name else ""
        raise ValueError(f"objects[{number}] ({item.kind}{name}): {error}") from None


def _actor(item: SceneObject, kind: int, phases: int, way_m: float) -> Actor:
    points = np.array([[*p, 0.0][:3] for p in item.waypoints], float)
    path: Path | None = None
    law: TimeLaw | None = None
    if len(points) > 1:
        corner = item.corner_m
        if corner is None:
            corner = _CORNER_M.get(item.kind, _VEHICLE_CORNER_M)
        path = build_path(points, corner, item.loop)
        law = _law(item, path)
        if item.repeat_s is not None and item.repeat_s < law.time_s[-1]:
            raise ValueError(
                f"repeat_s {item.repeat_s:g} is shorter than the way takes, {law.time_s[-1]:.1f} s"
            )
    return Actor(
        path=path,
        law=law,
        start_s=item.start_s,
        loop=item.loop,
        repeat_s=item.repeat_s or 0.0,
        present=item.present == "always",
        pose=(*points[0].tolist(), math.radians(item.yaw_deg)),
        kind=kind,
        phases=phases,
        way_m=way_m,
        vehicle=item.kind != "pedestrian",
        name=item.name,
        speed_mps=_even_speed(item),
    )


def _even_speed(item: SceneObject) -> float | None:
    """Speed of an object all the way [m/s]; None: it changes, or nobody said one."""
    speeds = set(item.speeds_mps or ())
    return speeds.pop() if len(speeds) == 1 else item.speed_mps


def _law(item: SceneObject, path: Path) -> TimeLaw:
    if item.times_s is not None:
        return law_of_times(path.waypoint_m, np.array(item.times_s, float), item.loop)
    speeds = item.speeds_mps or [item.speed_mps] * len(item.waypoints)
    waits = item.waits_s or [0.0] * len(item.waypoints)
    if item.loop:  # it waits at the first waypoint when it sets off, not again on arrival
        speeds, waits = [*speeds, speeds[0]], [*waits, 0.0]
    return law_of_speeds(path.waypoint_m, np.array(speeds, float), np.array(waits, float))


def script_of(objects: list[SceneObject]) -> MotionScript:
    """The script of a scene's objects without their meshes, which are what takes long.

    Raises:
        ValueError: see :func:`build_cast`.
    """
    return MotionScript([_checked_actor(n, item, 0, 0, 0.0) for n, item in enumerate(objects)])


def hull_size(item: SceneObject) -> tuple[float, float]:
    """Half length and half width of an object [m]."""
    if item.kind == "pedestrian":
        return _PERSON_HALF_M, _PERSON_HALF_M
    if item.kind == "cyclist":
        return LENGTH_M / 2, WIDTH_M / 2
    if item.kind in ("truck", "bus"):
        length, width = (heavy_body.TRUCK_M if item.kind == "truck" else heavy_body.BUS_M)[:2]
        return length / 2, width / 2
    shape = car_body.SHAPES["van" if item.kind == "van" else item.body]
    return shape.length_m / 2, shape.width_m / 2


def _kinds(item: SceneObject) -> tuple[list[ObjectKind], int, float]:
    """Kinds of one look: at rest, then the phases of its movement; their number and way [m]."""
    r, g, b = item.color or PAINTS[item.seed % len(PAINTS)]
    color: Color = (r, g, b)
    if item.kind in ("pedestrian", "cyclist"):
        return _people(item)
    mesh = MeshBuilder()
    half_length_m, half_width_m = hull_size(item)
    with mesh.place(-half_length_m, 0.0):
        if item.kind == "truck":
            heavy_body.add_truck(mesh, color, lit=True)
        elif item.kind == "bus":
            heavy_body.add_bus(mesh, color if item.color else _BUS_COLOR, lit=True)
        else:
            shape = car_body.SHAPES["van" if item.kind == "van" else item.body]
            car_body.add_car(mesh, color, False, 16, shape, lit=True)
    return [ObjectKind(item.kind, mesh.build(), half_length_m, half_width_m)], 0, 0.0


def _people(item: SceneObject) -> tuple[list[ObjectKind], int, float]:
    color: Color | None = None if item.color is None else tuple(item.color)  # type: ignore[assignment]
    kinds = []
    walker, half = item.kind == "pedestrian", hull_size(item)
    looks = random_looks(item.seed, color if walker else None)
    for k in range(-1, PHASES):
        mesh = MeshBuilder()
        phase = None if k < 0 else k / PHASES
        if walker:
            add_person(mesh, looks, phase)
        else:
            add_cyclist(mesh, looks, color or PAINTS[item.seed % len(PAINTS)], phase)
        name = item.kind if k < 0 else f"{item.kind} phase {k}"
        kinds.append(ObjectKind(name, mesh.build(), *half))
    return kinds, PHASES, looks.stride_m if walker else WAY_M
