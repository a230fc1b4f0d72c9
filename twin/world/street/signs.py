"""Traffic signs on poles and traffic lights.

A sign lies in its own axes: it stands at the origin and faces -x, towards traffic that drives +x.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.world.meshes import materials
from twin.world.meshes.mesh import Color, MeshBuilder

WHITE: Color = (0.72, 0.72, 0.70)
RED: Color = (0.50, 0.02, 0.025)
BLUE: Color = (0.02, 0.09, 0.36)
BLACK: Color = (0.015, 0.015, 0.015)
YELLOW: Color = (0.75, 0.46, 0.02)
GREY: Color = (0.33, 0.34, 0.35)
_HOUSING: Color = (0.025, 0.028, 0.027)

_SEGMENTS = {  # seven-segment digits, clockwise from the top, then the middle
    "0": (1, 1, 1, 1, 1, 1, 0),
    "3": (1, 1, 1, 1, 0, 0, 1),
    "5": (1, 0, 1, 1, 0, 1, 1),
}
_STEP_M = 0.006  # layers of sheeting


def _ring(radius_m: float, sides: int = 20, turn: float = 0.0) -> np.ndarray:
    angle = 2.0 * np.pi * np.arange(sides) / sides + turn
    return radius_m * np.stack([np.sin(angle), np.cos(angle)], axis=1)


def _rectangle(right: float, up: float, half_width: float, half_height: float) -> np.ndarray:
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (half_width, half_height)
    return corners + np.array((right, up))


class _Plate:
    """Stacks sheets on a plate centred at the height ``z_m``."""

    def __init__(self, mesh: MeshBuilder, z_m: float) -> None:
        self._mesh, self._z, self._x = mesh, z_m, -0.06

    def sheet(self, outline: np.ndarray, color: Color, lift: bool = True) -> None:
        """Add a sheet on top; ``lift`` false: in the same layer as the last one."""
        self._x -= _STEP_M * lift
        self._mesh.polygon(outline + np.array((0.0, self._z)), self._x, materials.SIGN, color)

    def back(self, outline: np.ndarray) -> None:
        """The grey back, seen from behind."""
        mirrored = outline * (-1.0, 1.0) + (0.0, self._z)
        self._mesh.polygon(mirrored, -0.06, materials.PLAIN, GREY, front=1.0)


def speed_limit(mesh: MeshBuilder, z_m: float, text: str = "50") -> None:
    """A red ring around a number."""
    plate = _Plate(mesh, z_m)
    plate.back(_ring(0.32))
    plate.sheet(_ring(0.32), RED)
    plate.sheet(_ring(0.25), WHITE)
    for i, digit in enumerate(text):
        centre = 0.17 * (i - (len(text) - 1) / 2)
        w, h, t = 0.055, 0.055, 0.016
        bars = [
            _rectangle(centre, 2 * h, w, t),
            _rectangle(centre + w, h, t, h),
            _rectangle(centre + w, -h, t, h),
            _rectangle(centre, -2 * h, w, t),
            _rectangle(centre - w, -h, t, h),
            _rectangle(centre - w, h, t, h),
            _rectangle(centre, 0.0, w, t),
        ]
        lift = i == 0
        for bar, on in zip(bars, _SEGMENTS[digit], strict=True):
            if on:
                plate.sheet(bar, BLACK, lift)
                lift = False


def stop(mesh: MeshBuilder, z_m: float) -> None:
    """A red octagon with white letters."""
    plate = _Plate(mesh, z_m)
    octagon = _ring(0.40, 8, np.pi / 8)
    plate.back(octagon)
    plate.sheet(octagon, WHITE)
    plate.sheet(octagon * 0.93, RED)
    letters = (
        [(0, 2, 1, 0.3), (-1, 1, 0.3, 1), (0, 0, 1, 0.3), (1, -1, 0.3, 1), (0, -2, 1, 0.3)],
        [(0, 2, 1.2, 0.3), (0, 0, 0.3, 2)],
        [(0, 2, 1, 0.3), (0, -2, 1, 0.3), (-1, 0, 0.3, 2.2), (1, 0, 0.3, 2.2)],
        [(-1, 0, 0.3, 2.2), (0, 2, 1, 0.3), (0, 0, 1, 0.3), (1, 1, 0.3, 1)],
    )
    for i, letter in enumerate(letters):
        for k, (x, y, w, h) in enumerate(letter):
            middle = 0.165 * (i - 1.5) + 0.05 * x
            bar = _rectangle(middle, 0.055 * y, 0.05 * w, 0.055 * h)
            plate.sheet(bar, WHITE, lift=i == k == 0)


def give_way(mesh: MeshBuilder, z_m: float) -> None:
    """A white triangle on its tip with a red border."""
    plate = _Plate(mesh, z_m)
    triangle = _ring(0.45, 3, np.pi / 3)
    plate.back(triangle)
    plate.sheet(triangle, RED)
    plate.sheet(triangle * 0.66, WHITE)


def no_parking(mesh: MeshBuilder, z_m: float) -> None:
    """A blue disc with a red ring and a red stroke."""
    plate = _Plate(mesh, z_m)
    plate.back(_ring(0.26))
    plate.sheet(_ring(0.26), RED)
    plate.sheet(_ring(0.20), BLUE)
    stroke = _rectangle(0.0, 0.0, 0.21, 0.03)
    turn = np.array([(0.7071, -0.7071), (0.7071, 0.7071)])
    plate.sheet(stroke @ turn, RED)


def crossing(mesh: MeshBuilder, z_m: float) -> None:
    """A blue square with a walker in a white triangle."""
    plate = _Plate(mesh, z_m)
    square = _rectangle(0.0, 0.0, 0.34, 0.34)
    plate.back(square)
    plate.sheet(square, WHITE)
    plate.sheet(square * 0.95, BLUE)
    plate.sheet(_ring(0.31, 3) + np.array((0.0, -0.05)), WHITE)
    plate.sheet(_ring(0.034, 8) + np.array((0.01, 0.085)), BLACK)
    for outline in (
        [(-0.03, -0.04), (0.03, -0.04), (0.035, 0.045), (-0.025, 0.045)],
        [(0.0, -0.05), (0.035, -0.03), (0.085, -0.17), (0.05, -0.18)],
        [(-0.03, -0.03), (0.005, -0.05), (-0.06, -0.18), (-0.095, -0.17)],
        [(0.02, 0.03), (0.035, 0.045), (0.10, -0.02), (0.085, -0.035)],
        [(-0.02, 0.045), (-0.01, 0.03), (-0.08, -0.035), (-0.095, -0.02)],
    ):
        plate.sheet(np.array(outline), BLACK, lift=False)


def priority(mesh: MeshBuilder, z_m: float) -> None:
    """A yellow diamond: this street has priority."""
    plate = _Plate(mesh, z_m)
    diamond = _ring(0.38, 4)
    plate.back(diamond)
    plate.sheet(diamond, WHITE)
    plate.sheet(diamond * 0.72, YELLOW)


Plate = Callable[[MeshBuilder, float], None]


def add_sign(mesh: MeshBuilder, plate: Plate, instance: int, z_m: float = 2.35) -> None:
    """A pole on the ground z = 0 with one plate, which is the instance."""
    with mesh.label("pole"):
        top = (0.0, 0.0, z_m + 0.42)
        mesh.tube((0.0, 0.0, 0.0), top, (0.038, 0.038), 6, materials.PLAIN, GREY)
    with mesh.label("traffic_sign", instance):
        plate(mesh, z_m)


_LENSES: tuple[Color, ...] = ((0.75, 0.03, 0.02), (0.70, 0.33, 0.01), (0.02, 0.60, 0.22))
_GREEN = 2


def _head(mesh: MeshBuilder, z_m: float, on: int) -> None:
    """Three lenses in a housing that faces -x; ``on`` of red, amber, green is lit."""
    mesh.box((-0.14, -0.17, z_m - 0.52), (0.10, 0.17, z_m + 0.52), materials.PLAIN, _HOUSING)
    floor = [(-0.14, -0.17), (-0.14, 0.17), (0.10, 0.17), (0.10, -0.17)]
    mesh.quad([(*p, z_m - 0.52) for p in floor], materials.PLAIN, _HOUSING)
    for i, color in enumerate(_LENSES):
        z = z_m + 0.33 * (1 - i)
        lens = _ring(0.115, 12) + np.array((0.0, z))
        dim: Color = (color[0] * 0.12, color[1] * 0.12, color[2] * 0.12)
        lit = i == on
        mesh.polygon(
            lens, -0.15, materials.SIGNAL if lit else materials.GLASS, color if lit else dim
        )
        y, out = 0.14, -0.34  # visor
        hood = [
            (-0.14, -y, z + 0.13),
            (out, -y, z + 0.10),
            (out, y, z + 0.10),
            (-0.14, y, z + 0.13),
        ]
        mesh.quad(hood, materials.PLAIN, _HOUSING)
        for side in (-y, y):
            cheek = [(-0.14, z - 0.05), (out, z + 0.02), (out, z + 0.10), (-0.14, z + 0.13)]
            mesh.quad([(a, side, b) for a, b in cheek], materials.PLAIN, _HOUSING)


def add_signal(mesh: MeshBuilder, green: bool, arm_m: float) -> None:
    """A traffic light on its pole; with ``arm_m`` > 0 a second head hangs over the lane, to +y."""
    on = _GREEN if green else 0
    height = 5.6 if arm_m > 0 else 3.3
    with mesh.label("pole"):
        base = ((0.0, 0.0, 0.0), (0.0, 0.0, height))
        mesh.tube(*base, (0.10, 0.07), 8, materials.PLAIN, GREY)
        if arm_m > 0:
            tip = (0.0, arm_m, height + 0.12)
            mesh.tube((0.0, 0.0, height - 0.1), tip, (0.06, 0.045), 6, materials.PLAIN, GREY)
        with mesh.place(-0.20, 0.0):
            _head(mesh, 2.75, on)
        if arm_m > 0:
            with mesh.place(-0.18, arm_m - 0.2):
                _head(mesh, height - 0.25, on)
