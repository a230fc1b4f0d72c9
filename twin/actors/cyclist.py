"""A cyclist on a bicycle, in phases of the pedals. Axes: x forward, origin below the middle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.actors.lamps import CLEAR, RED, VehicleLamp
from twin.actors.person import Looks, add_foot_shade
from twin.world.meshes import materials
from twin.world.meshes.mesh import Color, MeshBuilder

LENGTH_M, WIDTH_M = 1.75, 0.6
"""Hull of bicycle and rider [m]."""
WAY_M = 4.6
"""Way of one turn of the pedals [m]."""

_TYRE: Color = (0.02, 0.02, 0.02)
_STEEL: Color = (0.4, 0.4, 0.42)
_HELMET: Color = (0.6, 0.58, 0.1)
_WHEEL_M = 0.34


Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Seat:
    """Seat of somebody on two wheels; what lies to a side is the left one."""

    hip: Point
    chest: Point
    elbow: Point
    hand: Point
    helmet: Color = _HELMET


_ON_A_BICYCLE = Seat((-0.22, 0.0, 0.98), (0.12, 0.0, 1.47), (0.22, 0.27, 1.18), (0.42, 0.24, 1.01))


def _rod(mesh: MeshBuilder, a: Point, b: Point, radius_m: float, color: Color) -> None:
    mesh.tube(a, b, (radius_m, radius_m), 5, materials.PLAIN, color)


def _wheel(mesh: MeshBuilder, x_m: float) -> None:
    """A rim of straight pieces and some spokes."""
    angle = 2.0 * np.pi * np.arange(16) / 16
    rim = np.stack(
        [x_m + _WHEEL_M * np.cos(angle), 0 * angle, _WHEEL_M + _WHEEL_M * np.sin(angle)], 1
    )
    for i in range(16):
        mesh.tube(rim[i], rim[(i + 1) % 16], (0.02, 0.02), 4, materials.PLAIN, _TYRE)
    hub = np.array((x_m, 0.0, _WHEEL_M))
    for i in range(0, 16, 2):
        mesh.tube(hub, rim[i], (0.005, 0.004), 3, materials.PLAIN, _STEEL)


def add_cyclist(mesh: MeshBuilder, looks: Looks, frame: Color, phase: float | None) -> None:
    """Add a bicycle of colour ``frame`` with its rider; ``phase`` of the pedals, None: at rest."""
    rear, front = (-0.52, 0.0, _WHEEL_M), (0.54, 0.0, _WHEEL_M)
    crank, saddle, head = (-0.08, 0.0, 0.30), (-0.24, 0.0, 0.88), (0.38, 0.0, 0.82)
    with mesh.label("bicycle"):
        for x in (rear[0], front[0]):
            _wheel(mesh, x)
        for a, b in ((rear, crank), (rear, saddle), (crank, saddle), (crank, head), (saddle, head)):
            _rod(mesh, a, b, 0.018, frame)
        _rod(mesh, head, front, 0.018, _STEEL)
        bar = (0.40, 0.0, 0.98)
        _rod(mesh, head, bar, 0.015, _STEEL)
        _rod(mesh, (0.42, -0.27, 0.98), (0.42, 0.27, 0.98), 0.014, _TYRE)
        mesh.box((-0.38, -0.07, 0.88), (-0.12, 0.07, 0.94), materials.PLAIN, _TYRE)
        tail, head = materials.TAIL_LAMP, materials.HEAD_LAMP
        mesh.box((-0.62, -0.03, 0.62), (-0.58, 0.03, 0.70), tail, RED, VehicleLamp.TAIL)
        mesh.box((0.46, -0.03, 0.84), (0.50, 0.03, 0.90), head, CLEAR, VehicleLamp.HEAD)
        feet = _on_pedals(np.array(crank), 0.25 if phase is None else phase)
        add_rider(mesh, looks, _ON_A_BICYCLE, feet)
    add_foot_shade(mesh, 0.8, 0.2)


def _on_pedals(crank: np.ndarray, phase: float) -> list[np.ndarray]:
    feet = []
    for side in (1.0, -1.0):
        turn = 2.0 * np.pi * phase + (np.pi if side < 0 else 0.0)
        foot = crank + 0.17 * np.array((np.cos(turn), 0.0, -np.sin(turn)))
        feet.append(np.add(foot, (0.0, side * 0.12, 0.05)))
    return feet


def add_rider(mesh: MeshBuilder, looks: Looks, seat: Seat, feet: list[np.ndarray]) -> None:
    """Add who sits there with a helmet, the ``feet`` left and right."""
    hip, chest = np.array(seat.hip), np.array(seat.chest)
    for side, foot in zip((1.0, -1.0), feet, strict=True):
        mirror = np.array((1.0, side, 1.0))
        knee = _knee(hip + np.array((0.0, side * 0.10, 0.0)), foot, 0.46, 0.45)
        start = hip + np.array((0.0, side * 0.10, 0.0))
        mesh.tube(start, knee, (0.088, 0.060), 7, materials.PLAIN, looks.trousers)
        mesh.tube(knee, foot, (0.060, 0.042), 7, materials.PLAIN, looks.trousers)
        x, y, z = foot
        mesh.box(
            (x - 0.08, y - 0.045, z - 0.06), (x + 0.18, y + 0.045, z + 0.03), materials.PLAIN, _TYRE
        )
        shoulder = np.add(chest, (0.0, side * 0.20, -0.05))
        elbow, hand = mirror * seat.elbow, mirror * seat.hand
        mesh.tube(shoulder, elbow, (0.055, 0.046), 7, materials.PLAIN, looks.coat)
        mesh.tube(elbow, hand, (0.045, 0.032), 7, materials.PLAIN, looks.coat)
    mesh.tube(
        hip - (0.02, 0.0, 0.06),
        hip + 0.45 * (chest - hip),
        (0.15, 0.155),
        9,
        materials.PLAIN,
        looks.coat,
    )
    mesh.tube(hip + 0.45 * (chest - hip), chest, (0.155, 0.13), 9, materials.PLAIN, looks.coat)
    mesh.tube(
        chest, chest + np.array((0.05, 0.0, 0.06)), (0.13, 0.06), 9, materials.PLAIN, looks.coat
    )
    neck = chest + np.array((0.04, 0.0, 0.04))
    mesh.tube(
        neck, neck + np.array((0.03, 0.0, 0.10)), (0.052, 0.055), 8, materials.PLAIN, looks.skin
    )
    skull = neck + np.array((0.06, 0.0, 0.09))
    for z0, z1, r0, r1, color in (
        (0.0, 0.07, 0.062, 0.085, looks.skin),
        (0.07, 0.13, 0.085, 0.085, looks.skin),
        (0.12, 0.19, 0.105, 0.095, seat.helmet),
        (0.19, 0.24, 0.095, 0.04, seat.helmet),
    ):
        a, b = skull + np.array((0.0, 0.0, z0)), skull + np.array((0.0, 0.0, z1))
        mesh.tube(a, b, (r0, r1), 9, materials.PLAIN, color)


def _knee(hip: np.ndarray, foot: np.ndarray, thigh: float, shin: float) -> np.ndarray:
    """Place of the knee, to the front, for limbs of these lengths (two circles)."""
    way = foot - hip
    reach = min(float(np.linalg.norm(way)), 0.999 * (thigh + shin))
    along = (thigh**2 - shin**2 + reach**2) / (2.0 * reach)
    out = np.sqrt(max(0.0, thigh**2 - along**2))
    axis = way / np.linalg.norm(way)
    ahead = np.array((-axis[2], 0.0, axis[0]))
    return hip + along * axis + out * ahead
