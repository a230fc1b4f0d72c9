"""Meshes of a box truck and a city bus; rear bumper at x = 0, on z = 0."""

from __future__ import annotations

import numpy as np

from twin.actors.car_body import BLACK, add_pane, add_shade, add_wheel
from twin.actors.lamps import (
    AMBER,
    CLEAR,
    RED,
    LampPlaces,
    VehicleLamp,
    add_switched_lamps,
)
from twin.world.meshes import materials
from twin.world.meshes.mesh import Color, MeshBuilder

TRUCK_M = (7.2, 2.3, 3.2)
"""Length, width and height of the truck [m]."""
BUS_M = (11.8, 2.5, 3.1)
"""Length, width and height of the bus [m]."""

_CHASSIS: Color = (0.035, 0.035, 0.037)
_WHITE: Color = (0.72, 0.72, 0.70)


def _closed_box(
    mesh: MeshBuilder,
    low: tuple[float, float, float],
    high: tuple[float, float, float],
    material: int,
    color: Color,
) -> None:
    mesh.box(low, high, material, color)
    (x0, y0, z), (x1, y1, _) = low, high
    mesh.quad([(x0, y0, z), (x0, y1, z), (x1, y1, z), (x1, y0, z)], material, color)


def _lamps(
    mesh: MeshBuilder, length: float, half: float, tail_z: float, lit: bool, switched: bool
) -> None:
    tail = materials.TAIL_LAMP if lit else materials.REFLECTOR
    head = materials.HEAD_LAMP if lit else materials.GLASS
    for sign in (-1.0, 1.0):
        low, high = sorted((sign * (half - 0.34), sign * (half - 0.06)))
        corner = (0.05, high, tail_z + 0.14)
        mesh.box((-0.03, low, tail_z), corner, tail, RED, VehicleLamp.TAIL)
        if not switched:
            corner = (0.05, high, tail_z + 0.22)
            mesh.box((-0.03, low, tail_z + 0.14), corner, materials.REFLECTOR, AMBER)
        low, high = sorted((sign * (half - 0.46), sign * (half - 0.14)))
        corner = (length + 0.02, high, 0.84)
        mesh.box((length - 0.05, low, 0.66), corner, head, CLEAR, VehicleLamp.HEAD)
    if switched:
        add_switched_lamps(mesh, _switched(length, half, tail_z))
    corners = [
        (-0.032, 0.26, 0.5),
        (-0.032, -0.26, 0.5),
        (-0.032, -0.26, 0.61),
        (-0.032, 0.26, 0.61),
    ]
    mesh.quad(corners, materials.PLAIN, _WHITE)


def _switched(length: float, half: float, tail_z: float) -> LampPlaces:
    """Lamps above and beside the tail and head lamps."""
    # Standing out from the flap of a bus's engine: of faces in one plane the first is seen.
    rear, behind, top = -0.034, 0.05, tail_z + 0.14
    front = length - 0.05
    return LampPlaces(
        indicators=(
            ((rear, half - 0.34, top), (behind, half - 0.06, top + 0.08)),
            ((front, half - 0.13, 0.66), (length + 0.02, half - 0.07, 0.84)),
        ),
        reversing=((rear, half - 0.46, tail_z), (behind, half - 0.36, top)),
        fog_rear=((rear, half - 0.60, tail_z), (behind, half - 0.48, top)),
        # The bumper of a truck stands out further than its lamps above.
        fog_front=((front, half - 0.42, 0.48), (length + 0.04, half - 0.26, 0.58)),
    )


def add_truck(mesh: MeshBuilder, color: Color, lit: bool = False, switched: bool = False) -> None:
    """Add a box truck: cab in ``color``, a white box with a stripe."""
    length, width, height = TRUCK_M
    half, cab = width / 2, length - 1.9
    with mesh.label("truck"):
        _closed_box(mesh, (0.0, -half, 0.95), (cab - 0.12, half, height), materials.PLAIN, _WHITE)
        stripe = [(0.3, -half - 0.005, 1.5), (cab - 0.5, -half - 0.005, 1.5)]
        stripe += [(cab - 0.5, -half - 0.005, 2.1), (0.3, -half - 0.005, 2.1)]
        mesh.quad(stripe, materials.PLAIN, color)
        mesh.quad([(x, -y, z) for x, y, z in stripe[::-1]], materials.PLAIN, color)
        mesh.box((-0.02, -0.02, 1.0), (0.0, 0.02, height - 0.05), materials.PLAIN, _CHASSIS)
        _closed_box(mesh, (0.1, -0.5, 0.62), (cab, 0.5, 0.95), materials.PLAIN, _CHASSIS)
        _closed_box(
            mesh, (-0.02, 0.1 - half, 0.44), (0.1, half - 0.1, 0.62), materials.PLAIN, _CHASSIS
        )
        for sign in (-1.0, 1.0):  # side guards
            y = sign * (half - 0.12)
            mesh.box((1.9, y - 0.03, 0.45), (cab - 0.9, y + 0.03, 0.8), materials.PLAIN, _CHASSIS)
        _cab(mesh, color, cab, length, half)
        _lamps(mesh, length, half, 0.68, lit, switched)
        for x in (1.35, length - 1.05):
            for sign in (-1.0, 1.0):
                add_wheel(mesh, x, sign * (half - 0.02), 0.42, 16, 0.32)
    add_shade(mesh, (0.0, length), half)


def _cab(mesh: MeshBuilder, color: Color, x0: float, x1: float, half: float) -> None:
    """A cab over the engine, with a sloping screen."""
    w, low, belt, top = half - 0.06, 0.42, 1.45, 2.45
    profile = [(x0, low), (x1, low), (x1, belt - 0.1), (x1 - 0.32, top), (x0, top + 0.08)]
    right = np.array([(x, -w, z) for x, z in profile])
    left = right * (1.0, -1.0, 1.0)
    fan = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 4)])
    mesh.add(right, fan, materials.CAR_PAINT, color)
    mesh.add(
        left[::-1].copy(), np.array([(0, 1, 2), (0, 2, 3), (0, 3, 4)]), materials.CAR_PAINT, color
    )
    for i in range(1, 5):
        j = (i + 1) % 5
        mesh.quad([right[i], left[i], left[j], right[j]], materials.CAR_PAINT, color)
    screen = [(x1 - 0.035, -w + 0.1, belt), (x1 - 0.035, w - 0.1, belt)]
    screen += [(x1 - 0.275, w - 0.14, top - 0.12), (x1 - 0.275, -w + 0.14, top - 0.12)]
    add_pane(mesh, [(x + 0.03, y, z) for x, y, z in screen])
    mesh.box((x1 - 0.02, 0.15 - w, low), (x1 + 0.03, w - 0.15, 0.62), materials.PLAIN, _CHASSIS)
    mesh.box((x1 - 0.02, -0.5, 0.95), (x1 + 0.008, 0.5, 1.2), materials.PLAIN, _CHASSIS)
    for sign in (-1.0, 1.0):
        y = sign * (w + 0.014)
        rear, high = x0 + 0.45, top - 0.16
        pane = [(rear, y, belt), (x1 - 0.2, y, belt), (x1 - 0.42, y, high), (rear, y, high)]
        add_pane(mesh, pane if sign < 0 else pane[::-1])
        a, b = sorted((sign * (w + 0.04), sign * (w + 0.24)))
        mesh.box((x1 - 0.2, a, 1.5), (x1 - 0.12, b, 1.95), materials.PLAIN, BLACK)


def add_bus(mesh: MeshBuilder, color: Color, lit: bool = False, switched: bool = False) -> None:
    """Add a low-floor city bus with doors on its right side."""
    length, width, height = BUS_M
    half = width / 2
    with mesh.label("bus"):
        _closed_box(mesh, (0.0, -half, 0.32), (length, half, height), materials.CAR_PAINT, color)
        mesh.box(
            (0.8, 0.35 - half, height), (3.6, half - 0.35, height + 0.22), materials.PLAIN, _WHITE
        )
        for sign in (-1.0, 1.0):
            _bus_side(mesh, sign, half, length)
        y, x = half - 0.14, length + 0.016
        add_pane(mesh, [(x, -y, 1.05), (x, y, 1.05), (x, y, 2.5), (x, -y, 2.5)])
        board = [(x, -0.8, 2.58), (x, 0.8, 2.58), (x, 0.8, 2.9), (x, -0.8, 2.9)]
        mesh.quad(board, materials.SIGN, (0.60, 0.34, 0.02))
        y, x = half - 0.2, -0.016
        add_pane(mesh, [(x, y, 1.5), (x, -y, 1.5), (x, -y, 2.5), (x, y, 2.5)])
        mesh.box((-0.03, -0.9, 0.8), (0.0, 0.9, 1.3), materials.PLAIN, _CHASSIS)
        for sign in (-1.0, 1.0):  # mirrors
            a, b = sorted((sign * (half + 0.05), sign * (half + 0.25)))
            mesh.box((length + 0.05, a, 1.7), (length + 0.2, b, 2.15), materials.PLAIN, BLACK)
        _lamps(mesh, length, half, 1.0, lit, switched)
        for x in (3.0, length - 2.7):
            for sign in (-1.0, 1.0):
                add_wheel(mesh, x, sign * (half + 0.02), 0.48, 18, 0.30)
    add_shade(mesh, (0.0, length), half)


def _bus_side(mesh: MeshBuilder, sign: float, half: float, length: float) -> None:
    """Windows along one side; the right side (``sign`` -1) has two doors."""
    y = sign * (half + 0.014)
    doors = ((length - 1.75, length - 0.45), (5.0, 6.3)) if sign < 0 else ()
    cuts = np.linspace(0.4, length - 0.4, 8)
    for a, b in zip(cuts[:-1] + 0.05, cuts[1:] - 0.05, strict=True):
        if any(a < d1 and b > d0 for d0, d1 in doors):
            continue
        pane = [(a, y, 1.25), (b, y, 1.25), (b, y, 2.5), (a, y, 2.5)]
        add_pane(mesh, pane if sign < 0 else pane[::-1])
    for d0, d1 in doors:
        middle = (d0 + d1) / 2
        for a, b in ((d0, middle - 0.03), (middle + 0.03, d1)):
            add_pane(mesh, [(a, y, 0.45), (b, y, 0.45), (b, y, 2.5), (a, y, 2.5)])
    skirt = [(0.05, y, 0.34), (length - 0.05, y, 0.34), (length - 0.05, y, 0.62), (0.05, y, 0.62)]
    mesh.quad(skirt if sign < 0 else skirt[::-1], materials.PLAIN, _CHASSIS)
