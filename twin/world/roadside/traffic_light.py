"""Heads of traffic lights: a housing with lenses whose lamps every slot switches on its own.

A head lies in its own axes: it stands on z = 0, its lenses face -x.
"""

from __future__ import annotations

import numpy as np

from twin.world.meshes import materials
from twin.world.meshes.mesh import Color, MeshBuilder
from twin.world.roadside.plates import ring

HEAD_M, WALK_HEAD_M = 0.96, 0.64
"""Heights of heads for vehicles and for people whose size is not given [m]."""
RED_LAMP, AMBER_LAMP, GREEN_LAMP = 0, 1, 2
"""Numbers of lamps."""
LAMPS = 8
"""Numbers of lamps that a head may have: the tag of a lens is 8 x head + lamp."""
_HOUSING: Color = (0.025, 0.028, 0.027)
_COLORS: dict[int, Color] = {
    RED_LAMP: (0.75, 0.03, 0.02),
    AMBER_LAMP: (0.70, 0.33, 0.01),
    GREEN_LAMP: (0.02, 0.60, 0.22),
}


def head_deep_m(height_m: float, *, walk: bool) -> float:
    """Half the depth of a head of a height [m]."""
    return 0.2 * height_m / (2 if walk else 3)


def add_head(mesh: MeshBuilder, height_m: float, head: int, *, walk: bool) -> None:
    """A head of ``height_m``.

    Args:
        mesh: receives it.
        height_m: of its housing.
        head: its number among the signals of the world.
        walk: for people: red and green; else red, amber and green.
    """
    lamps = (RED_LAMP, GREEN_LAMP) if walk else (RED_LAMP, AMBER_LAMP, GREEN_LAMP)
    pitch = height_m / len(lamps)
    half, radius, x = 0.5 * pitch, 0.36 * pitch, -head_deep_m(height_m, walk=walk)
    mesh.box((x, -half, 0.0), (-x, half, height_m), materials.PLAIN, _HOUSING)
    floor = [(x, -half, 0.0), (x, half, 0.0), (-x, half, 0.0), (-x, -half, 0.0)]
    mesh.quad(floor, materials.PLAIN, _HOUSING)
    for row, lamp in enumerate(lamps):
        z = height_m - (row + 0.5) * pitch
        lens = ring(radius, 16)[::-1] + np.array((0.0, z))
        points = np.column_stack([np.full(16, x - 0.01), lens[:, 0] * -1.0, lens[:, 1]])
        fan = np.array([(0, k, k + 1) for k in range(1, 15)])
        mesh.add(points, fan, materials.SIGNAL_LAMP, _COLORS[lamp], LAMPS * head + lamp)
        _add_visor(mesh, x, z, radius, pitch)


def _add_visor(mesh: MeshBuilder, x: float, z: float, radius: float, pitch: float) -> None:
    y, out = 1.15 * radius, x - 0.55 * pitch
    high, low = z + 1.1 * radius, z + 0.85 * radius
    hood = [(x, -y, high), (out, -y, low), (out, y, low), (x, y, high)]
    mesh.quad(hood, materials.PLAIN, _HOUSING)
    for side in (-y, y):
        cheek = [(x, z - 0.4 * radius), (out, z + 0.2 * radius), (out, low), (x, high)]
        mesh.quad([(a, side, b) for a, b in cheek], materials.PLAIN, _HOUSING)
