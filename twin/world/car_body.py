"""The mesh of a passenger car, lofted from a side profile."""

from __future__ import annotations

import numpy as np

from twin.world import materials
from twin.world.mesh import Color, MeshBuilder

LENGTH_M, WIDTH_M, HEIGHT_M = 4.5, 1.8, 1.46
"""Hull of the car, as colliders and distances see it [m]."""

_BLACK: Color = (0.02, 0.02, 0.022)
_GLASS: Color = (0.03, 0.035, 0.04)
_RIM: Color = (0.30, 0.31, 0.32)

# Side profile, rear to front: share of the length, half width share, sill height, shoulder height.
_STATIONS = np.array(
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
)


def add_car(mesh: MeshBuilder, color: Color, hazard: bool, wheel_sides: int = 12) -> None:
    """Add a car whose rear bumper is at x = 0 and whose nose is at x = LENGTH_M, on z = 0.

    ``hazard``: its indicator lamps blink, as after a breakdown.
    """
    _body(mesh, color)
    _cabin(mesh, color)
    _lamps(mesh, hazard)
    for x in (0.83, 3.52):
        for side in (-1.0, 1.0):
            _wheel(mesh, x, side, wheel_sides)
    _contact_shadow(mesh)


def _body(mesh: MeshBuilder, color: Color) -> None:
    half = WIDTH_M / 2
    # One ring per station: sill to shoulder on the left, over the deck, down the right side.
    rings = []
    for share, width, sill, shoulder in _STATIONS:
        w, height = half * width, shoulder - sill
        ring = [
            (0.88 * w, sill),
            (0.985 * w, sill + 0.18 * height),
            (1.0 * w, sill + 0.55 * height),
            (0.965 * w, sill + 0.86 * height),
            (0.86 * w, shoulder),
            (0.45 * w, shoulder + 0.035),
        ]
        ring += [(-y, z) for y, z in reversed(ring)]
        rings.append([(share * LENGTH_M, y, z) for y, z in ring])
    points = np.array(rings)
    stations, size = points.shape[:2]
    faces = []
    for i in range(stations - 1):
        for j in range(size - 1):
            a, b = i * size + j, (i + 1) * size + j
            faces += [(a, b, b + 1), (a, b + 1, a + 1)]
    flat = points.reshape(-1, 3)
    mesh.add(flat, np.array(faces), materials.CAR_PAINT, color)
    for row in (0, stations - 1):
        fan = [(row * size, row * size + j, row * size + j + 1) for j in range(1, size - 1)]
        mesh.add(flat, np.array(fan), materials.CAR_PAINT, color)
    mesh.box((0.0, -0.80, 0.28), (0.10, 0.80, 0.46), materials.PLAIN, _BLACK)
    mesh.box((4.42, -0.72, 0.26), (4.49, 0.72, 0.42), materials.PLAIN, _BLACK)
    mesh.box((0.4, -0.78, 0.16), (4.1, 0.78, 0.24), materials.PLAIN, _BLACK)


def _cabin(mesh: MeshBuilder, color: Color) -> None:
    # Corners of the greenhouse: belt line and roof, rear and front, right and left.
    belt = [(0.16, 0.80, 0.93), (3.28, 0.80, 0.90)]
    roof = [(0.72, 0.60, 1.40), (2.35, 0.61, HEIGHT_M)]

    def side(sign: float) -> list[tuple[float, float, float]]:
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
    for corners, share in ((right, 0.80), (left[::-1], 0.80), (rear, 0.84), (front, 0.88)):
        mesh.quad(_inset(corners, share, 0.012), materials.GLASS, _GLASS)
    for sign in (-1.0, 1.0):  # pillar between the doors, mirrors
        mesh.box(
            (1.62, sign * 0.72 - 0.06, 0.92),
            (1.72, sign * 0.72 + 0.06, 1.30),
            materials.PLAIN,
            _BLACK,
        )
        mesh.box(
            (2.72, sign * 0.92 - 0.08, 0.94),
            (2.84, sign * 0.92 + 0.08, 1.08),
            materials.PLAIN,
            _BLACK,
        )


def _inset(
    corners: list[tuple[float, float, float]], share: float, lift_m: float
) -> list[list[float]]:
    """A quad shrunk about its centre and lifted off along its normal."""
    points = np.array(corners)
    centre = points.mean(axis=0)
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    normal /= np.linalg.norm(normal)
    return (centre + share * (points - centre) + lift_m * normal).tolist()


def _lamps(mesh: MeshBuilder, hazard: bool) -> None:
    amber: Color = (0.70, 0.25, 0.03)
    blink = materials.HAZARD if hazard else materials.REFLECTOR
    for sign in (-1.0, 1.0):
        low, high = sorted((sign * 0.48, sign * 0.80))
        mesh.box((-0.01, low, 0.62), (0.10, high, 0.78), materials.REFLECTOR, (0.42, 0.02, 0.02))
        low, high = sorted((sign * 0.66, sign * 0.86))
        mesh.box((-0.005, low, 0.78), (0.10, high, 0.88), blink, amber)
        low, high = sorted((sign * 0.50, sign * 0.74))
        mesh.box((4.36, low, 0.52), (4.50, high, 0.66), materials.GLASS, (0.5, 0.5, 0.52))
    mesh.quad(
        [(-0.012, 0.26, 0.50), (-0.012, -0.26, 0.50), (-0.012, -0.26, 0.61), (-0.012, 0.26, 0.61)],
        materials.PLAIN,
        (0.75, 0.75, 0.70),
    )


def _wheel(mesh: MeshBuilder, x_m: float, sign: float, sides: int) -> None:
    outer, inner = sign * (WIDTH_M / 2 + 0.005), sign * (WIDTH_M / 2 - 0.22)
    mesh.tube((x_m, inner, 0.32), (x_m, outer, 0.32), (0.32, 0.32), sides, materials.PLAIN, _BLACK)
    mesh.disc((x_m, outer, 0.32), 0.32, sign, sides, materials.PLAIN, _BLACK)
    mesh.disc((x_m, outer + sign * 0.008, 0.32), 0.21, sign, sides, materials.PLAIN, _RIM)


def _contact_shadow(mesh: MeshBuilder) -> None:
    """Darker asphalt around the hull: skylight is missing below a car."""
    for step, (grow, shade) in enumerate(((0.32, 0.80), (0.14, 0.55), (-0.04, 0.28))):
        x0, x1 = -grow, LENGTH_M + grow
        y = WIDTH_M / 2 + grow
        z = 0.012 + 0.004 * step
        mesh.quad(
            [(x0, -y, z), (x1, -y, z), (x1, y, z), (x0, y, z)],
            materials.ASPHALT,
            (0.09 * shade, 0.09 * shade, 0.095 * shade),
        )
