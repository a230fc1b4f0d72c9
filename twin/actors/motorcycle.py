"""A motorcycle with its rider. Axes: x forward, the rear end at x = 0."""

from __future__ import annotations

import numpy as np

from twin.actors.cyclist import Seat, add_rider
from twin.actors.lamps import CLEAR, RED, VehicleLamp
from twin.actors.person import Looks, add_foot_shade
from twin.world.meshes import materials
from twin.world.meshes.mesh import Color, MeshBuilder

SIZE_M = (2.08, 0.79, 1.5)
"""Length and width of the machine, height of the rider's helmet [m]."""

_BLACK: Color = (0.02, 0.02, 0.02)
_METAL: Color = (0.30, 0.30, 0.31)
_ENGINE: Color = (0.10, 0.10, 0.105)
_WHEEL_M, _AXLES_M = 0.31, (-0.72, 0.70)
_SEAT = Seat(
    hip=(-0.28, 0.0, 0.85),
    chest=(0.08, 0.0, 1.13),
    elbow=(0.14, 0.34, 0.97),
    hand=(0.36, 0.33, 1.00),
    helmet=(0.55, 0.55, 0.54),
)


def add_motorcycle(mesh: MeshBuilder, looks: Looks, paint: Color) -> None:
    """Add a motorcycle of colour ``paint`` with its rider."""
    with mesh.label("bicycle"), mesh.place(SIZE_M[0] / 2, 0.0):
        for x, half in zip(_AXLES_M, (0.08, 0.055), strict=True):
            _wheel(mesh, x, half)
        _machine(mesh, paint)
        feet = [np.array((-0.22, side * 0.22, 0.36)) for side in (1.0, -1.0)]
        add_rider(mesh, looks, _SEAT, feet)
        add_foot_shade(mesh, 1.0, 0.25)


def _wheel(mesh: MeshBuilder, x_m: float, half_m: float) -> None:
    """A tyre of flat pieces with two discs."""
    angle = 2.0 * np.pi * np.arange(16) / 16
    rim = np.stack([x_m + _WHEEL_M * np.cos(angle), _WHEEL_M + _WHEEL_M * np.sin(angle)], 1)
    points = np.concatenate([np.insert(rim, 1, y, axis=1) for y in (-half_m, half_m)])
    i = np.arange(16)
    j = (i + 1) % 16
    faces = np.concatenate([np.stack([i, j + 16, j], 1), np.stack([i, i + 16, j + 16], 1)])
    mesh.add(points, faces, materials.PLAIN, _BLACK)
    for sign in (-1.0, 1.0):
        centre = (x_m, sign * half_m, _WHEEL_M)
        mesh.disc(centre, _WHEEL_M, sign, 16, materials.PLAIN, _BLACK)
        mesh.disc((x_m, sign * (half_m + 0.004), _WHEEL_M), 0.17, sign, 12, materials.PLAIN, _METAL)


def _machine(mesh: MeshBuilder, paint: Color) -> None:
    """Fork, frame, engine, tank, seat, exhaust, bar with mirrors, and the lamps."""
    plain = materials.PLAIN
    rear, front = _AXLES_M
    for sign in (-1.0, 1.0):
        side = sign * 0.11
        mesh.tube((front, side, _WHEEL_M), (0.36, side, 0.93), (0.028, 0.034), 7, plain, _METAL)
        mesh.tube((rear, side, _WHEEL_M), (-0.16, side, 0.42), (0.03, 0.035), 6, plain, _ENGINE)
        mesh.tube((rear, side, _WHEEL_M), (-0.46, side, 0.72), (0.022, 0.022), 6, plain, _METAL)
        mesh.tube((0.33, sign * 0.02, 0.98), (0.33, sign * 0.38, 1.00), (0.016, 0.016), 6, plain,
                  _BLACK)  # fmt: skip
        mesh.tube((0.35, sign * 0.28, 1.00), (0.40, sign * 0.34, 1.16), (0.008, 0.008), 5, plain,
                  _BLACK)  # fmt: skip
        low, high = sorted((sign * 0.29, sign * 0.39))
        mesh.box((0.39, low, 1.13), (0.42, high, 1.20), plain, _BLACK)
    mesh.tube((-0.15, -0.17, 0.34), (-0.92, -0.20, 0.44), (0.05, 0.065), 9, plain, _METAL)
    mesh.box((-0.18, -0.19, 0.20), (0.30, 0.19, 0.56), plain, _ENGINE)
    mesh.box((-0.30, -0.13, 0.56), (0.10, 0.13, 0.72), plain, _ENGINE)
    mesh.tube((-0.12, 0.0, 0.80), (0.36, 0.0, 0.84), (0.13, 0.16), 10, plain, paint)
    mesh.box((-0.72, -0.14, 0.74), (-0.10, 0.14, 0.84), plain, _BLACK)
    mesh.box((-0.90, -0.11, 0.70), (-0.55, 0.11, 0.80), plain, paint)
    mesh.box((-1.04, -0.08, 0.52), (-0.88, 0.08, 0.56), plain, _BLACK)
    mesh.box((0.50, -0.09, 0.60), (0.92, 0.09, 0.64), plain, paint)
    mesh.box((0.38, -0.11, 0.80), (0.50, 0.11, 1.00), plain, paint)
    head, tail = materials.HEAD_LAMP, materials.TAIL_LAMP
    mesh.box((0.49, -0.09, 0.83), (0.53, 0.09, 0.96), head, CLEAR, VehicleLamp.HEAD)
    mesh.box((-0.94, -0.08, 0.71), (-0.90, 0.08, 0.78), tail, RED, VehicleLamp.TAIL)
