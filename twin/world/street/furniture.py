"""What stands on the sidewalks: lamps, benches, bins, hydrants, bollards, a bus shelter.

Each piece lies in its own axes: on z = 0, with its front to -y (the roadway lies there).
"""

from __future__ import annotations

import numpy as np

from twin.world.meshes import materials
from twin.world.meshes.mesh import Color, MeshBuilder

POST: Color = (0.06, 0.065, 0.06)
_WOOD: Color = (0.22, 0.12, 0.06)
_STEEL: Color = (0.34, 0.35, 0.36)
_CAST: Color = (0.05, 0.055, 0.05)
_HYDRANT: Color = (0.45, 0.03, 0.025)
_POSTER: Color = (0.10, 0.22, 0.42)
_CLAY: Color = (0.30, 0.22, 0.17)


def slab(
    mesh: MeshBuilder,
    low: tuple[float, float, float],
    high: tuple[float, float, float],
    color: Color,
    material: int = materials.PLAIN,
) -> None:
    """A box with an underside, for what does not stand on the ground."""
    mesh.box(low, high, material, color)
    (x0, y0, z), (x1, y1, _) = low, high
    mesh.quad([(x0, y0, z), (x0, y1, z), (x1, y1, z), (x1, y0, z)], material, color)


def add_lamp(mesh: MeshBuilder, height_m: float) -> None:
    """A street lamp whose arm reaches 1.6 m over the roadway."""
    top = (0.0, 0.0, height_m)
    head = (0.0, -1.6, height_m + 0.15)
    with mesh.label("pole"):
        mesh.tube((0, 0, 0), (0, 0, 1.1), (0.13, 0.11), 6, materials.PLAIN, POST)
        mesh.tube((0, 0, 1.1), top, (0.08, 0.055), 6, materials.PLAIN, POST)
        mesh.tube(top, head, (0.045, 0.04), 4, materials.PLAIN, POST)
    with mesh.label("lamp"):
        z = head[2]
        mesh.box((-0.16, -2.3, z - 0.05), (0.16, -1.5, z + 0.08), materials.PLAIN, POST)
        face = [(-0.13, -2.3, z - 0.06), (-0.13, -1.5, z - 0.06)]
        face += [(0.13, -1.5, z - 0.06), (0.13, -2.3, z - 0.06)]
        mesh.quad(face, materials.STREET_LAMP, (0.8, 0.8, 0.75))


def add_bench(mesh: MeshBuilder) -> None:
    """Slats on two cast feet."""
    for x in (-0.72, 0.72):
        mesh.box((x - 0.03, -0.24, 0.0), (x + 0.03, 0.24, 0.42), materials.PLAIN, _CAST)
    slab(mesh, (-0.9, -0.22, 0.42), (0.9, 0.19, 0.46), _WOOD)
    slab(mesh, (-0.9, 0.19, 0.55), (0.9, 0.23, 0.86), _WOOD)


def add_bin(mesh: MeshBuilder) -> None:
    """A litter bin with a hood."""
    mesh.tube((0, 0, 0), (0, 0, 0.82), (0.22, 0.25), 9, materials.PLAIN, (0.04, 0.09, 0.06))
    mesh.tube((0, 0, 0.82), (0, 0, 0.98), (0.27, 0.10), 9, materials.PLAIN, _CAST)
    _lid(mesh, 0.10, 0.98, _CAST, 9)


def _lid(mesh: MeshBuilder, radius_m: float, z_m: float, color: Color, sides: int = 8) -> None:
    angle = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.stack([radius_m * np.cos(angle), radius_m * np.sin(angle), np.full(sides, z_m)], 1)
    fan = np.array([(0, i, i + 1) for i in range(1, sides - 1)])
    mesh.add(ring, fan, materials.PLAIN, color)


def add_hydrant(mesh: MeshBuilder) -> None:
    """A red fire hydrant."""
    mesh.tube((0, 0, 0), (0, 0, 0.08), (0.17, 0.17), 8, materials.PLAIN, _HYDRANT)
    mesh.tube((0, 0, 0.08), (0, 0, 0.60), (0.115, 0.11), 8, materials.PLAIN, _HYDRANT)
    mesh.tube((0, 0, 0.60), (0, 0, 0.74), (0.13, 0.05), 8, materials.PLAIN, _HYDRANT)
    _lid(mesh, 0.17, 0.08, _HYDRANT)
    _lid(mesh, 0.05, 0.74, _HYDRANT)
    mesh.tube((-0.2, 0, 0.46), (0.2, 0, 0.46), (0.06, 0.06), 6, materials.PLAIN, _STEEL)


def add_bollard(mesh: MeshBuilder) -> None:
    """A waist-high post."""
    with mesh.label("pole"):
        mesh.tube((0, 0, 0), (0, 0, 0.92), (0.06, 0.055), 6, materials.PLAIN, _CAST)
        _lid(mesh, 0.055, 0.92, _CAST, 6)


def add_planter(mesh: MeshBuilder) -> None:
    """A clay tub; what grows in it is added at 0.5 m."""
    mesh.tube((0, 0, 0), (0, 0, 0.5), (0.26, 0.34), 9, materials.PLAIN, _CLAY)
    _lid(mesh, 0.33, 0.46, (0.05, 0.035, 0.025), 9)


def add_cabinet(mesh: MeshBuilder) -> None:
    """A switch cabinet."""
    mesh.box((-0.45, -0.16, 0.0), (0.45, 0.16, 1.15), materials.PLAIN, (0.27, 0.29, 0.27))
    mesh.box((-0.48, -0.19, 1.15), (0.48, 0.19, 1.2), materials.PLAIN, (0.2, 0.21, 0.2))


def add_shelter(mesh: MeshBuilder) -> None:
    """A bus shelter of 4 m with glass walls, a bench and a poster, and the stop's sign pole."""
    half = 2.0
    for x in (-half, 0.0, half):
        mesh.box((x - 0.04, 0.56, 0.0), (x + 0.04, 0.64, 2.3), materials.PLAIN, POST)
    for x in (-half, half):
        mesh.box((x - 0.04, -0.66, 0.0), (x + 0.04, -0.58, 2.3), materials.PLAIN, POST)
    slab(mesh, (-half - 0.15, -0.8, 2.3), (half + 0.15, 0.75, 2.42), POST)
    glass: Color = (0.10, 0.12, 0.125)
    for x0, x1 in ((-half + 0.04, -0.04), (0.04, half - 0.04)):
        slab(mesh, (x0, 0.59, 0.25), (x1, 0.61, 2.2), glass, materials.GLASS)
    slab(mesh, (-half - 0.01, -0.5, 0.25), (-half + 0.01, 0.5, 2.2), _POSTER, materials.PLASTER)
    slab(mesh, (-1.4, 0.2, 0.42), (1.4, 0.5, 0.47), _WOOD)
    for x in (-1.2, 1.2):
        mesh.box((x - 0.03, 0.3, 0.0), (x + 0.03, 0.4, 0.42), materials.PLAIN, _CAST)
    with mesh.label("pole"):
        pole = ((3.0, -0.5, 0.0), (3.0, -0.5, 2.9))
        mesh.tube(*pole, (0.035, 0.035), 6, materials.PLAIN, _STEEL)
    slab(mesh, (2.75, -0.52, 2.35), (3.25, -0.48, 2.85), (0.72, 0.55, 0.04))
