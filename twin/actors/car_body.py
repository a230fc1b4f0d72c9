"""Meshes of cars, lofted from a side profile: a hatchback, a saloon, an off-roader and a van."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from twin.actors.lamps import (
    AMBER,
    CLEAR,
    RED,
    LampPlaces,
    VehicleLamp,
    add_switched_lamps,
)
from twin.world.meshes import materials
from twin.world.meshes.mesh import DECAL, Color, MeshBuilder

LENGTH_M, WIDTH_M, HEIGHT_M = 4.5, 1.8, 1.46
"""Hull of the hatchback, which is the obstacle, as colliders and distances see it [m]."""

BLACK: Color = (0.02, 0.02, 0.022)
GLASS: Color = (0.03, 0.035, 0.04)
RIM: Color = (0.30, 0.31, 0.32)
_INSIDE: Color = (0.018, 0.018, 0.02)
_SEAM: Color = (0.012, 0.012, 0.013)
ASPHALT: Color = (0.09, 0.09, 0.095)

Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class CarShape:
    """Measures of a car; x runs from the rear bumper to the nose [m]."""

    name: str
    length_m: float
    width_m: float
    height_m: float
    stations: np.ndarray
    """Rear to front: share of the length, half width share, sill height, shoulder height [m]."""
    belt: tuple[Point, Point]
    """Lower rear and lower front corner of the greenhouse on the left: x, y, z."""
    roof: tuple[Point, Point]
    """Upper rear and upper front corner."""
    axles_m: tuple[float, float]
    wheel_m: float
    """Radius of a wheel."""
    pillars_m: tuple[float, ...]
    """Places of the pillars between the side windows, x."""
    blind: tuple[float, float] | None = None
    """Stretch of the sides without windows, x; a delivery van has one."""
    tail_z_m: float = 0.70
    """Height of the tail lamps."""


_HATCH = CarShape(
    name="hatchback",
    length_m=LENGTH_M,
    width_m=WIDTH_M,
    height_m=HEIGHT_M,
    stations=np.array(
        [
            (0.000, 0.86, 0.42, 0.78),
            (0.015, 0.93, 0.33, 0.90),
            (0.060, 0.975, 0.24, 0.96),
            (0.200, 1.0, 0.20, 0.955),
            (0.500, 1.0, 0.19, 0.925),
            (0.700, 1.0, 0.19, 0.90),
            (0.850, 0.985, 0.20, 0.82),
            (0.945, 0.94, 0.24, 0.74),
            (0.985, 0.87, 0.30, 0.66),
            (1.000, 0.80, 0.40, 0.56),
        ]
    ),
    belt=((0.16, 0.80, 0.93), (3.28, 0.80, 0.90)),
    roof=((0.72, 0.60, 1.40), (2.35, 0.61, HEIGHT_M)),
    axles_m=(0.83, 3.52),
    wheel_m=0.32,
    pillars_m=(1.62,),
)


def _lifted(shape: CarShape, low_m: float, high_m: float) -> np.ndarray:
    """The stations with sills raised by ``low_m`` and shoulders by ``high_m``."""
    return shape.stations + np.array((0.0, 0.0, low_m, high_m))


SHAPES = {
    "hatchback": _HATCH,
    "saloon": replace(
        _HATCH,
        name="saloon",
        length_m=4.75,
        width_m=1.84,
        height_m=1.44,
        belt=((0.85, 0.80, 0.95), (3.42, 0.80, 0.90)),
        roof=((1.50, 0.59, 1.41), (2.55, 0.60, 1.44)),
        axles_m=(0.98, 3.78),
        pillars_m=(1.98,),
        tail_z_m=0.78,
    ),
    "suv": replace(
        _HATCH,
        name="suv",
        length_m=4.6,
        width_m=1.88,
        height_m=1.70,
        stations=_lifted(_HATCH, 0.06, 0.16),
        belt=((0.10, 0.84, 1.08), (3.35, 0.84, 1.06)),
        roof=((0.42, 0.68, 1.65), (2.55, 0.68, 1.70)),
        axles_m=(0.88, 3.58),
        wheel_m=0.36,
        pillars_m=(0.95, 1.85),
        tail_z_m=0.84,
    ),
    "van": replace(
        _HATCH,
        name="van",
        length_m=5.2,
        width_m=1.96,
        height_m=2.12,
        stations=_lifted(_HATCH, 0.05, 0.22),
        belt=((0.03, 0.90, 1.14), (4.35, 0.88, 1.10)),
        roof=((0.12, 0.82, 2.10), (3.35, 0.80, 2.12)),
        axles_m=(0.95, 4.20),
        wheel_m=0.34,
        pillars_m=(3.05,),
        blind=(0.0, 3.0),
        tail_z_m=0.92,
    ),
}


def add_car(
    mesh: MeshBuilder,
    color: Color,
    hazard: bool,
    wheel_sides: int = 12,
    shape: CarShape = _HATCH,
    lit: bool = False,
    switched: bool = False,
) -> None:
    """Add a car whose rear bumper is at x = 0 and whose nose is at its length, on z = 0.

    Args:
        color: of the paint.
        hazard: its indicator lamps blink, as after a breakdown.
        wheel_sides: corners of a wheel; up to 12 gives a simpler body as well.
        shape: which body.
        lit: head and tail lamps are those of a vehicle in traffic.
        switched: indicators, reversing and fog lamps are lamps as well.
    """
    with mesh.label("car"):
        coarse = wheel_sides <= 12
        _body(mesh, color, shape, coarse)
        _cabin(mesh, color, shape)
        _trim(mesh, color, shape, coarse)
        _lamps(mesh, hazard, shape, lit, switched)
        for x in shape.axles_m:
            for side in (-1.0, 1.0):
                add_wheel(mesh, x, side * shape.width_m / 2, shape.wheel_m, wheel_sides)
    add_shade(mesh, (0.0, shape.length_m), shape.width_m / 2)


def _body(mesh: MeshBuilder, color: Color, shape: CarShape, coarse: bool) -> None:
    half = shape.width_m / 2
    # One ring per station: sill to shoulder on the left, over the deck, down the right side.
    rings = []
    for share, width, sill, shoulder in shape.stations:
        w, height = half * width, shoulder - sill
        ring = [
            (0.88 * w, sill),
            (0.985 * w, sill + 0.18 * height),
            (1.0 * w, sill + 0.55 * height),
            (0.965 * w, sill + 0.86 * height),
            (0.86 * w, shoulder),
            (0.45 * w, shoulder + 0.035),
        ]
        if coarse:
            ring = [ring[0], ring[2], ring[3], ring[4]]
        ring += [(-y, z) for y, z in reversed(ring)]
        rings.append([(share * shape.length_m, y, z) for y, z in ring])
    points = np.array(rings)
    stations, size = points.shape[:2]
    faces = []
    for i in range(stations - 1):
        for j in range(size - 1):
            a, b = i * size + j, (i + 1) * size + j
            faces += [(a, b + 1, b), (a, a + 1, b + 1)]
    flat = points.reshape(-1, 3)
    mesh.add(flat, np.array(faces), materials.CAR_PAINT, color)
    last = (stations - 1) * size
    rear = [(0, j + 1, j) for j in range(1, size - 1)]
    nose = [(last, last + j, last + j + 1) for j in range(1, size - 1)]
    mesh.add(flat, np.array(rear + nose), materials.CAR_PAINT, color)


def _trim(mesh: MeshBuilder, color: Color, shape: CarShape, coarse: bool) -> None:
    """Bumpers, floor, grille, seams of the doors, handles and mirrors."""
    end, half = shape.length_m, shape.width_m / 2
    mesh.box((-0.012, 0.1 - half, 0.28), (0.10, half - 0.1, 0.46), materials.PLAIN, BLACK)
    mesh.box(
        (end - 0.08, 0.18 - half, 0.26), (end - 0.006, half - 0.18, 0.42), materials.PLAIN, BLACK
    )
    mesh.box((0.4, 0.12 - half, 0.16), (end - 0.4, half - 0.12, 0.24), materials.PLAIN, BLACK)
    nose = shape.stations[-1, 3]
    if coarse:
        _mirrors(mesh, color, shape)
        return
    grille = np.array([(-0.42, -0.15), (0.42, -0.15), (0.36, -0.01), (-0.36, -0.01)])
    mesh.polygon(grille + np.array((0.0, nose)), end + 0.004, materials.PLAIN, _SEAM, front=1.0)
    belt = shape.belt[1][2]
    seams = (shape.pillars_m[-1], shape.belt[1][0] - 0.35)
    for sign in (-1.0, 1.0):
        y = sign * (half + 0.002)
        for x in (*seams, shape.pillars_m[0] - 0.85):
            if shape.axles_m[0] + 0.05 < x < shape.axles_m[1] - 0.05:
                _strip(mesh, (x, x + 0.012), y, (0.30, 0.55 * belt + 0.36), sign, _SEAM)
        handle = shape.pillars_m[-1] + 0.10
        bar = (0.80 * belt, 0.80 * belt + 0.03)
        _strip(mesh, (handle, handle + 0.16), y + sign * 0.004, bar, sign, BLACK)
    _mirrors(mesh, color, shape)


def _mirrors(mesh: MeshBuilder, color: Color, shape: CarShape) -> None:
    half, belt = shape.width_m / 2, shape.belt[1][2]
    for sign in (-1.0, 1.0):
        x = shape.belt[1][0] - 0.52
        low, high = sorted((sign * (half - 0.04), sign * (half + 0.14)))
        mesh.box((x, low, belt + 0.04), (x + 0.10, high, belt + 0.19), materials.CAR_PAINT, color)


def _strip(
    mesh: MeshBuilder,
    x_m: tuple[float, float],
    y_m: float,
    z_m: tuple[float, float],
    sign: float,
    color: Color,
) -> None:
    """A thin upright rectangle on a side of the body."""
    (x0, x1), (z0, z1) = x_m, z_m
    corners = [(x0, y_m, z0), (x1, y_m, z0), (x1, y_m, z1), (x0, y_m, z1)]
    mesh.quad(corners if sign < 0 else corners[::-1], materials.PLAIN, color)


def _cabin(mesh: MeshBuilder, color: Color, shape: CarShape) -> None:
    belt, roof = shape.belt, shape.roof

    def side(sign: float) -> list[Point]:
        return [
            (belt[0][0], sign * belt[0][1], belt[0][2]),
            (belt[1][0], sign * belt[1][1], belt[1][2]),
            (roof[1][0], sign * roof[1][1], roof[1][2]),
            (roof[0][0], sign * roof[0][1], roof[0][2]),
        ]

    right, left = side(-1.0), side(1.0)
    rear = [left[0], right[0], right[3], left[3]]
    front = [right[1], left[1], left[2], right[2]]
    top = [right[3], right[2], left[2], left[3]]
    for corners in (right, left[::-1], rear, front, top):
        mesh.quad(corners, materials.CAR_PAINT, color)
    for corners, share in ((rear, 0.84), (front, 0.90)):
        add_pane(mesh, _inset(corners, share, 0.012))
    for corners, sign in ((right, -1.0), (left, 1.0)):
        _side_windows(mesh, np.array(corners), sign, shape)


def _side_windows(mesh: MeshBuilder, corners: np.ndarray, sign: float, shape: CarShape) -> None:
    """Panes between the pillars of one side, in its plane."""
    rear_low, front_low, front_high, rear_high = corners
    cuts = [rear_low[0], *shape.pillars_m, front_low[0]]
    for a, b in pairwise(cuts):
        if shape.blind is not None and shape.blind[0] <= (a + b) / 2 <= shape.blind[1]:
            continue

        def at(x: float, share: float) -> np.ndarray:
            """The point of the side at ``x`` of the belt line and a share of the way up."""
            s = (x - rear_low[0]) / (front_low[0] - rear_low[0])
            low = rear_low + s * (front_low - rear_low)
            # Inner pillars stand upright; the outer edges follow the screens.
            top = (low[0] - rear_high[0]) / (front_high[0] - rear_high[0])
            high = rear_high + np.clip(top, 0.0, 1.0) * (front_high - rear_high)
            return low + share * (high - low)

        x0 = a + (0.14 if a == cuts[0] else 0.05)
        x1 = b - (0.16 if b == cuts[-1] else 0.05)
        pane = [at(x0, 0.10), at(x1, 0.10), at(x1, 0.86), at(x0, 0.86)]
        pane = pane if sign < 0 else pane[::-1]
        add_pane(mesh, _inset(pane, 1.0, 0.012))


def add_pane(mesh: MeshBuilder, corners: Sequence[Sequence[float]]) -> None:
    """A pane of a vehicle: glass before a dark inside."""
    mesh.quad(_inset(corners, 1.0, -0.006), materials.PLAIN, _INSIDE)
    mesh.quad(corners, materials.GLASS, GLASS)


def _inset(corners: Sequence[Sequence[float]], share: float, lift_m: float) -> list[list[float]]:
    """A quad shrunk about its centre and lifted off along its normal."""
    points = np.array(corners)
    centre = points.mean(axis=0)
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    normal /= np.linalg.norm(normal)
    return (centre + share * (points - centre) + lift_m * normal).tolist()


def _lamps(mesh: MeshBuilder, hazard: bool, shape: CarShape, lit: bool, switched: bool) -> None:
    blink = materials.HAZARD if hazard else materials.REFLECTOR
    tail = materials.TAIL_LAMP if lit else materials.REFLECTOR
    head = materials.HEAD_LAMP if lit else materials.GLASS
    end, half, z = shape.length_m, shape.width_m / 2, shape.tail_z_m
    nose = shape.stations[-1, 3]
    for sign in (-1.0, 1.0):
        low, high = sorted((sign * (half - 0.42), sign * (half - 0.10)))
        mesh.box((-0.01, low, z - 0.08), (0.10, high, z + 0.08), tail, RED, VehicleLamp.TAIL)
        if not switched:
            low, high = sorted((sign * (half - 0.24), sign * (half - 0.04)))
            mesh.box((-0.005, low, z + 0.08), (0.10, high, z + 0.18), blink, AMBER)
        low, high = sorted((sign * (half - 0.40), sign * (half - 0.16)))
        corner = (end, high, nose + 0.10)
        mesh.box((end - 0.14, low, nose - 0.04), corner, head, CLEAR, VehicleLamp.HEAD)
    if switched:
        add_switched_lamps(mesh, _switched(shape))
    plate: Color = (0.75, 0.75, 0.70)
    x, low = -0.012, z - 0.20
    corners = [(x, 0.26, low), (x, -0.26, low), (x, -0.26, low + 0.11), (x, 0.26, low + 0.11)]
    mesh.quad(corners, materials.PLAIN, plate)
    x = end + 0.006
    corners = [(x, -0.26, 0.34), (x, 0.26, 0.34), (x, 0.26, 0.45), (x, -0.26, 0.45)]
    mesh.quad(corners, materials.PLAIN, plate)


def _switched(shape: CarShape) -> LampPlaces:
    """Lamps beside, above and below those that every car has."""
    end, half, z = shape.length_m, shape.width_m / 2, shape.tail_z_m
    nose = shape.stations[-1, 3]
    return LampPlaces(
        indicators=(
            ((-0.005, half - 0.24, z + 0.08), (0.10, half - 0.04, z + 0.18)),
            ((end - 0.14, half - 0.40, nose - 0.12), (end + 0.003, half - 0.16, nose - 0.05)),
        ),
        reversing=((-0.01, half - 0.56, z - 0.08), (0.10, half - 0.44, z + 0.04)),
        fog_rear=((-0.02, half - 0.60, 0.31), (0.10, half - 0.42, 0.38)),
        fog_front=((end - 0.08, half - 0.42, 0.30), (end, half - 0.30, 0.38)),
    )


def add_wheel(
    mesh: MeshBuilder, x_m: float, side_m: float, radius_m: float, sides: int, broad_m: float = 0.22
) -> None:
    """A wheel in its arch; ``side_m``: y of the body's side, which the wheel ends at."""
    sign = 1.0 if side_m > 0 else -1.0
    outer, inner = side_m + sign * 0.012, side_m - sign * broad_m
    axle = (x_m, outer, radius_m)
    arch = (x_m, side_m + sign * 0.003, radius_m + 0.02)
    dark, rim = materials.PLAIN, (x_m, outer + sign * 0.008, radius_m)
    mesh.disc(arch, 1.16 * radius_m, sign, max(8, sides // 2), dark, _SEAM)
    mesh.tube((x_m, inner, radius_m), axle, (radius_m, radius_m), sides, dark, BLACK)
    mesh.disc(axle, radius_m, sign, sides, dark, BLACK)
    mesh.disc(rim, 0.64 * radius_m, sign, max(8, sides // 2), dark, RIM)
    if sides > 12:
        hub = (x_m, outer + sign * 0.012, radius_m)
        mesh.disc(hub, 0.15 * radius_m, sign, 6, dark, BLACK)


def add_shade(mesh: MeshBuilder, x_m: tuple[float, float], half_m: float) -> None:
    """Darker asphalt around a hull: skylight is missing below a vehicle. No part of the object."""
    with mesh.label("road", instance=-1):
        for step, (grow, shade) in enumerate(((0.32, 0.80), (0.14, 0.55), (-0.04, 0.28))):
            x0, x1 = x_m[0] - grow, x_m[1] + grow
            y = half_m + grow
            z = 0.012 + 0.004 * step
            mesh.quad(
                [(x0, -y, z), (x1, -y, z), (x1, y, z), (x0, y, z)],
                materials.ASPHALT,
                (ASPHALT[0] * shade, ASPHALT[1] * shade, ASPHALT[2] * shade),
                DECAL,
            )
