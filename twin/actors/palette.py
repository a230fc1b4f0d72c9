"""Looks of bodies that a scenario brings: one set of meshes serves all cases of a rig.

Which bodies a case has is known only when it begins, and the meshes of a rig are fixed before. So a
body gets the mesh of its sort whose size is nearest to its own; what it collides with, and its box
in tables, is its own size. Bodies of one case that look alike differ in colour by their number.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from schemas.messages import OBJECT_CLASSES
from twin.actors import car_body, heavy_body
from twin.actors.cyclist import LENGTH_M, WAY_M, WIDTH_M, add_cyclist
from twin.actors.lamps import AMBER, VehicleLamp
from twin.actors.motion import ObjectKind, Placement
from twin.actors.motorcycle import SIZE_M as MOTORCYCLE_M
from twin.actors.motorcycle import add_motorcycle
from twin.actors.person import PHASES, Looks, add_person, random_looks
from twin.world.meshes import materials
from twin.world.meshes.mesh import DECAL, Color, Mesh, MeshBuilder
from twin.world.street.parking import PAINTS

Size = tuple[float, float, float]
"""Length, width, height [m]."""

CLASS_OF = {
    "car": "car",
    "van": "car",
    "truck": "truck",
    "trailer": "truck",
    "bus": "bus",
    "motorcycle": "bicycle",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
    "child": "pedestrian",
    "animal": "pedestrian",
    "obstacle": "car",
}
"""Sort of a body -> its class for the box sensor, which knows no more than these."""

_BUS: Color = (0.50, 0.36, 0.06)
_GREY: Color = (0.30, 0.30, 0.30)
_FUR: Color = (0.16, 0.10, 0.06)
_DARK: Color = (0.03, 0.03, 0.035)
_ADULTS_M = (None, None, None, 1.8)
"""Heights of adults, None: as tall as they happen to be; the last is that of ISO 19206-2 [m]."""
_CHILDREN_M = (1.154, 1.2, 1.3)
"""The first is that of ISO 19206-2 [m]."""
_TALLER = 1.0172
"""Height of a person's mesh over that of its looks."""
_RIDER_M = 1.86
_BICYCLE_M = (1.89, 0.6, 1.86)
"""With its rider, of ISO 19206-4."""
_CARS = ((4.023, 1.712, 1.427), (4.3, 1.8, 1.5))
"""Hatchbacks of rulebooks: the global vehicle target (ISO 19206-3), and a small car [m]."""
_ANIMALS = ((0.8, 0.3, 0.6), (1.7, 0.5, 1.4))
_OBSTACLES = (
    *((0.3, 0.3, 0.15), (0.6, 0.6, 0.6), (1.2, 0.8, 0.8), (2.0, 1.5, 1.2), (4.0, 1.8, 1.4)),
    (0.3, 1.0, 1.2),  # a board
)
_PLATES = ((0.7, 0.7, 0.02), (3.7, 2.4, 0.025))
_STEEL: Color = (0.34, 0.33, 0.32)
FLAT_M = 0.1
"""What is no higher lies on the road and is driven over, as a plate of steel; it looks like one,
and nothing takes it for an object [m]."""
_TRAILERS = ((3.0, 1.7, 1.6), (7.2, 2.4, 3.2), (13.0, 2.5, 3.8))


@dataclass(frozen=True, slots=True)
class PaletteLook:
    """One look of a sort of bodies."""

    sort: str
    size_m: Size
    """Length, width and height of its mesh."""
    kind: int
    """Kind of it at rest, and before its phases."""
    phases: int
    """Kinds behind the first that show it moving; 0: one for all."""
    way_m: float
    """Way in which all phases pass once."""


@dataclass(frozen=True, slots=True)
class Palette:
    """All looks, and the kinds that their indices mean."""

    kinds: tuple[ObjectKind, ...]
    looks: tuple[PaletteLook, ...]

    def look(self, sort: str, size_m: Sequence[float], number: int) -> PaletteLook:
        """The look of body ``number`` of a case: of its sort the one of the nearest size, of
        equally near ones as the number says. What is flat looks flat, and nothing else does.

        Args:
            sort: key of :data:`CLASS_OF`.
            size_m: length, width, height.
            number: counts the bodies of a case.
        """
        of_sort = [look for look in self.looks if look.sort == sort]
        flat = size_m[2] <= FLAT_M
        alike = [look for look in of_sort if (look.size_m[2] <= FLAT_M) == flat] or of_sort
        off = [
            sum((a - b) * (a - b) for a, b in zip(look.size_m, size_m, strict=True))
            for look in alike
        ]
        nearest = [look for look, way in zip(alike, off, strict=True) if way == min(off)]
        return nearest[number % len(nearest)]


class BodyRoom:
    """Room for bodies that something else moves: nobody is there until it says so."""

    actors = ()

    def __init__(self, count: int) -> None:
        self.count = count
        """Most bodies of a slot."""

    @property
    def standing(self) -> np.ndarray:
        """See :class:`twin.actors.motion.Motion`."""
        return np.zeros(self.count, np.int32)

    def at(self, time_s: np.ndarray, varied: object = None) -> Placement:  # noqa: ARG002 - empty
        """See :class:`twin.actors.motion.Motion`."""
        return nobody(len(time_s), self.count)


def nobody(slots: int, count: int) -> Placement:
    """A placement in which no body is there."""
    flat, wide = np.zeros((slots, count)), np.zeros((slots, count, 3))
    return Placement(
        kind=np.full((slots, count), -1, np.int32),
        position_m=wide,
        yaw_rad=flat,
        velocity_mps=wide.copy(),
        yaw_rate_radps=flat.copy(),
        brake=flat.astype(np.float32),
        lamps=flat.astype(np.float32),
        half_m=np.zeros((slots, count, 2)),
        class_index=np.zeros((slots, count), np.int32),
    )


def build_palette() -> Palette:
    """The looks that every rig with bodies has; the same each time."""
    palette = _Builder()
    for name, shape in car_body.SHAPES.items():
        size = (shape.length_m, shape.width_m, shape.height_m)
        for paint in PAINTS[:4]:
            palette.vehicle(
                "van" if name == "van" else "car",
                size,
                lambda mesh, paint=paint, shape=shape: car_body.add_car(
                    mesh, paint, False, 16, shape, lit=True, switched=True
                ),
            )
    hatchback = car_body.SHAPES["hatchback"]
    for size in _CARS:
        palette.vehicle(
            "car",
            size,
            lambda mesh: car_body.add_car(
                mesh, PAINTS[0], False, 16, hatchback, lit=True, switched=True
            ),
            (hatchback.length_m, hatchback.width_m, hatchback.height_m),
        )
    for paint in PAINTS[:3]:
        palette.vehicle(
            "truck",
            heavy_body.TRUCK_M,
            lambda mesh, paint=paint: heavy_body.add_truck(mesh, paint, lit=True, switched=True),
        )
    for paint in (_BUS, PAINTS[1]):
        palette.vehicle(
            "bus",
            heavy_body.BUS_M,
            lambda mesh, paint=paint: heavy_body.add_bus(mesh, paint, lit=True, switched=True),
        )
    for size in _TRAILERS:
        palette.vehicle("trailer", size, lambda mesh, size=size: _add_trailer(mesh, size))
    for seed, height_m in enumerate(_ADULTS_M):
        palette.people("pedestrian", random_looks(seed), height_m)
    for seed, height_m in enumerate(_CHILDREN_M):
        palette.people("child", replace(random_looks(seed + 10), bag=False), height_m)
    for seed in range(2):
        palette.riders(random_looks(seed), PAINTS[seed])
    palette.vehicle(
        "motorcycle",
        MOTORCYCLE_M,
        lambda mesh: add_motorcycle(mesh, random_looks(5), PAINTS[2]),
    )
    for size in _ANIMALS:
        palette.vehicle("animal", size, lambda mesh, size=size: _add_animal(mesh, size))
    for size in _OBSTACLES:
        palette.vehicle("obstacle", size, lambda mesh, size=size: _add_block(mesh, size))
    for size in _PLATES:
        palette.vehicle("obstacle", size, lambda mesh, size=size: _add_plate(mesh, size))
    return Palette(tuple(palette.kinds), tuple(palette.looks))


class _Builder:
    """Kinds and looks so far."""

    def __init__(self) -> None:
        self.kinds: list[ObjectKind] = []
        self.looks: list[PaletteLook] = []

    def vehicle(
        self,
        sort: str,
        size: Size,
        add: Callable[[MeshBuilder], None],
        drawn: Size | None = None,
    ) -> None:
        """One kind, whose rear end ``add`` puts at x = 0; of the size ``drawn``, if it is stretched
        to its own."""
        length, width, _ = size
        mesh = MeshBuilder()
        with mesh.place(-(drawn or size)[0] / 2, 0.0):
            add(mesh)
        self.looks.append(PaletteLook(sort, size, len(self.kinds), 0, 1.0))
        whole = _stretched(mesh.build(), drawn or size, size)
        self.kinds.append(ObjectKind(sort, whole, length / 2, width / 2))

    def people(self, sort: str, looks: Looks, height_m: float | None) -> None:
        """Somebody who stands, and the phases of a stride."""
        if height_m is not None:
            looks = replace(looks, height_m=height_m / _TALLER)
        size = (0.5 * looks.height_m / 1.75, 0.5 * looks.height_m / 1.75, _TALLER * looks.height_m)
        self.looks.append(PaletteLook(sort, size, len(self.kinds), PHASES, looks.stride_m))
        for k in range(-1, PHASES):
            mesh = MeshBuilder()
            add_person(mesh, looks, None if k < 0 else k / PHASES)
            self._phase(sort, k, mesh.build(), size)

    def riders(self, looks: Looks, frame: Color) -> None:
        """A cyclist at rest, and the phases of the pedals."""
        stretch = _BICYCLE_M[0] / LENGTH_M
        self.looks.append(
            PaletteLook("bicycle", _BICYCLE_M, len(self.kinds), PHASES, WAY_M * stretch)
        )
        for k in range(-1, PHASES):
            mesh = MeshBuilder()
            add_cyclist(mesh, looks, frame, None if k < 0 else k / PHASES)
            whole = _stretched(mesh.build(), (LENGTH_M, WIDTH_M, _RIDER_M), _BICYCLE_M)
            self._phase("bicycle", k, whole, _BICYCLE_M)

    def _phase(self, sort: str, k: int, mesh: Mesh, size: Size) -> None:
        name = sort if k < 0 else f"{sort} phase {k}"
        self.kinds.append(ObjectKind(name, mesh, size[0] / 2, size[1] / 2))


def _stretched(mesh: Mesh, drawn: Size, size: Size) -> Mesh:
    if drawn == size:
        return mesh
    return replace(mesh, points_m=mesh.points_m * (np.array(size) / drawn))


def _add_trailer(mesh: MeshBuilder, size: Size) -> None:
    length, width, height = size
    half, floor, lamps = width / 2, 0.3 * height, VehicleLamp
    with mesh.label("truck"):
        mesh.box((0.0, -half, floor), (length, half, height), materials.PLAIN, _GREY)
        mesh.box((0.1, -0.4, 0.2), (length - 0.1, 0.4, floor), materials.PLAIN, _DARK)
        for sign in (-1.0, 1.0):
            car_body.add_wheel(mesh, 0.3 * length, sign * (half - 0.02), 0.4, 16)
            low, high = sorted((sign * (half - 0.34), sign * (half - 0.06)))
            corner = (0.02, high, floor + 0.14)
            mesh.box((-0.03, low, floor), corner, materials.TAIL_LAMP, (0.42, 0, 0), lamps.TAIL)
            indicator = lamps.INDICATOR_LEFT if sign > 0 else lamps.INDICATOR_RIGHT
            corner = (0.02, high, floor + 0.22)
            mesh.box((-0.03, low, floor + 0.14), corner, materials.VEHICLE_LAMP, AMBER, indicator)
    car_body.add_shade(mesh, (0.0, length), half)


def _add_animal(mesh: MeshBuilder, size: Size) -> None:
    """Four legs, a body and a head that looks ahead."""
    length, width, height = size
    half, belly, back = width / 2, 0.45 * height, 0.8 * height
    with mesh.label("unlabelled"):
        mesh.box((0.05 * length, -half, belly), (0.8 * length, half, back), materials.PLAIN, _FUR)
        mesh.box(
            (0.75 * length, -0.6 * half, back - 0.1 * height),
            (length, 0.6 * half, height),
            materials.PLAIN,
            _FUR,
        )
        for x in (0.12 * length, 0.72 * length):
            for y in (-0.7 * half, 0.7 * half):
                mesh.tube((x, y, belly), (x, y, 0.0), (0.06, 0.04), 6, materials.PLAIN, _FUR)
    car_body.add_shade(mesh, (0.0, length), half)


def _add_block(mesh: MeshBuilder, size: Size) -> None:
    length, width, height = size
    with mesh.label("unlabelled"):
        mesh.box((0.0, -width / 2, 0.0), (length, width / 2, height), materials.PLAIN, _GREY)
    car_body.add_shade(mesh, (0.0, length), width / 2)


def _add_plate(mesh: MeshBuilder, size: Size) -> None:
    """A part of the road, to the box sensor too."""
    length, width, height = size
    with mesh.label("road", instance=-1):
        corners = (0.0, -width / 2, 0.0), (length, width / 2, height)
        mesh.box(*corners, materials.PLAIN, _STEEL, DECAL)


def class_index(sort: str) -> int:
    """Index of a sort's class in :data:`schemas.messages.OBJECT_CLASSES`."""
    return OBJECT_CLASSES.index(CLASS_OF[sort])
