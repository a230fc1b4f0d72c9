"""What wheels roll on: the plane z = 0, or a mesh with a grip for every face."""

from __future__ import annotations

import numpy as np
import warp as wp

from schemas.messages import SEMANTIC_CLASSES
from twin.vehicle.face_grid import (
    FaceGrid,
    corner_of,
    face_grid,
    face_normal,
    faces_near,
    is_below,
)
from twin.world.content import DRIVABLE
from twin.world.meshes import materials
from twin.world.meshes.mesh import DECAL
from twin.world.street.build import World

_GRIP = {materials.PAVING: 0.9}
"""Friction of a surface over that of asphalt; wet paving stones are a little smoother [-]."""

STOREY_M = 2.5
"""Between ground closer than this above one another there is no room for a car [m]."""
_EDGE = 1e-9

_ABOVE = wp.constant(wp.float64(0.25))
_BELOW = wp.constant(wp.float64(4.0))
_NOWHERE = wp.constant(wp.float64(-1.0e4))
_STEEPEST = wp.constant(wp.float64(1.0e-3))
"""Upward part of the normal of the steepest face that carries a wheel [-]."""
_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))


@wp.struct
class Ground:
    """A ground for kernels."""

    flat: wp.int32
    """1: the plane z = 0, and the faces are not asked."""
    grid: FaceGrid
    grip: wp.array(dtype=wp.float64)
    """Friction over that of asphalt, per face [-]."""


@wp.struct
class GroundPoint:
    """The ground below a point: height [m], unit normal, grip [-]."""

    height: wp.float64
    normal: wp.vec3d
    grip: wp.float64


@wp.func
def surface_below(ground: Ground, p: wp.vec3d) -> GroundPoint:
    """The ground straight below ``p``; far below where there is none.

    Of all faces below a place that is a little above ``p``, the highest one; of equally high ones
    the first. Faces come in ascending order and in double precision, so a level mesh at z = 0 gives
    exactly the plane's values, and every device finds the same face.
    """
    s = GroundPoint()
    s.normal = wp.vec3d(_ZERO, _ZERO, _ONE)
    s.grip = _ONE
    if ground.flat != 0:
        return s
    s.height = _NOWHERE
    top = p[2] + _ABOVE
    bounds = faces_near(ground.grid, p[0], p[1])
    for i in range(bounds[0], bounds[1]):
        face = ground.grid.faces[i]
        if is_below(ground.grid, face, p):
            a = corner_of(ground.grid, face, 0)
            n = face_normal(ground.grid, face)
            if n[2] > _STEEPEST:
                height = a[2] - (n[0] * (p[0] - a[0]) + n[1] * (p[1] - a[1])) / n[2]
                if height <= top and height >= top - _BELOW and height > s.height:
                    # The sum turns -0.0 into 0.0, as the plane has it.
                    s.normal = n + wp.vec3d(_ZERO, _ZERO, _ZERO)
                    s.height = height
                    s.grip = ground.grip[face]
    return s


class GroundMesh:
    """Holds a ground's arrays; ``kernel`` is what kernels take."""

    def __init__(
        self, device: wp.Device, points_m: np.ndarray, faces: np.ndarray, grip: np.ndarray
    ):
        """``points_m`` [V, 3], ``faces`` [F, 3], ``grip`` [F]."""
        self.kernel = Ground()
        self.kernel.grid = face_grid(points_m[faces].astype(np.float32), device)
        self.kernel.grip = wp.array(grip, dtype=wp.float64, device=device)


class FlatGround:
    """The plane z = 0 with the grip of asphalt."""

    def __init__(self, device: wp.Device) -> None:
        self.kernel = Ground()
        self.kernel.flat = 1
        self.kernel.grip = wp.zeros(1, dtype=wp.float64, device=device)


def drivable(world: World, device: wp.Device) -> GroundMesh:
    """The part of a world's mesh that wheels can stand on.

    Static faces whose class is road, sidewalk or terrain, at any height. Paint has no height for a
    tyre, and objects and their contact shadows are no ground.

    Raises:
        ValueError: there is none; one line.
    """
    mesh, wanted = world.mesh, _drivable_faces(world)
    if not wanted.any():
        raise ValueError(
            "the scene has no ground: no face with semantic "
            f"{', '.join(DRIVABLE)} (other than paint)"
        )
    grip = np.array([_GRIP.get(int(m), 1.0) for m in mesh.material[wanted]])
    if mesh.grip is not None:
        own = mesh.grip[wanted]
        grip = np.where(np.isnan(own), grip, own)
    return GroundMesh(device, mesh.points_m, mesh.faces[wanted], grip)


def height_near(world: World, x_m: float, y_m: float, z_m: float) -> float:
    """Height of the ground at a place, for somebody who was at height ``z_m`` before [m].

    Of several storeys the one nearest to that height; ``z_m`` where there is no ground.
    """
    points = world.mesh.points_m[world.mesh.faces[_drivable_faces(world)]].astype(float)
    a, b, c = points[:, 0], points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    x, y = x_m - a[:, 0], y_m - a[:, 1]
    area = b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0]
    upright = area == 0.0
    area = np.where(upright, 1.0, area)
    u = (x * c[:, 1] - y * c[:, 0]) / area
    v = (b[:, 0] * y - b[:, 1] * x) / area
    inside = ~upright & (u >= -_EDGE) & (v >= -_EDGE) & (u + v <= 1.0 + _EDGE)
    heights = (a[:, 2] + u * b[:, 2] + v * c[:, 2])[inside]
    if not len(heights):
        return z_m
    heights.sort()
    # What lies closely below ground carries nobody: grass below a road, a road below a kerb.
    tops = heights[np.append(np.diff(heights) > STOREY_M, True)]
    return float(tops[np.argmin(np.abs(tops - z_m))])


def _drivable_faces(world: World) -> np.ndarray:
    mesh = world.mesh
    classes = [SEMANTIC_CLASSES.index(name) for name in DRIVABLE]
    wanted: np.ndarray = np.isin(mesh.semantic, classes)
    wanted &= (mesh.instance < 0) & (mesh.material != materials.PAINT) & (mesh.tag != DECAL)
    return wanted
