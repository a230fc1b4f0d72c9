"""What wheels roll on: the plane z = 0, or a mesh with a grip for every face."""

from __future__ import annotations

import numpy as np
import warp as wp

from schemas.messages import SEMANTIC_CLASSES
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
_BELOW = wp.constant(wp.float32(4.0))
_NOWHERE = wp.constant(wp.float64(-1.0e4))
_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))


@wp.struct
class Ground:
    """A ground for kernels."""

    flat: wp.int32
    """1: the plane z = 0, and the mesh is not asked."""
    mesh: wp.uint64
    grip: wp.array(dtype=wp.float64)
    """Friction over that of asphalt, per face [-]."""


@wp.struct
class GroundPoint:
    """The ground below a point: height [m], unit normal, grip [-]."""

    height: wp.float64
    normal: wp.vec3d
    grip: wp.float64


@wp.func
def _corner(mesh: wp.uint64, index: wp.int32) -> wp.vec3d:
    p = wp.mesh_get_point(mesh, index)
    return wp.vec3d(wp.float64(p[0]), wp.float64(p[1]), wp.float64(p[2]))


@wp.func
def surface_below(ground: Ground, p: wp.vec3d) -> GroundPoint:
    """The ground straight below ``p``; far below where there is none.

    The ray only finds the face: height and normal follow from its corners in double precision, so
    a level mesh at z = 0 gives exactly the plane's values.
    """
    s = GroundPoint()
    s.normal = wp.vec3d(_ZERO, _ZERO, _ONE)
    s.grip = _ONE
    if ground.flat != 0:
        return s
    s.height = _NOWHERE
    start = wp.vec3(wp.float32(p[0]), wp.float32(p[1]), wp.float32(p[2] + _ABOVE))
    hit = wp.mesh_query_ray(ground.mesh, start, wp.vec3(0.0, 0.0, -1.0), _BELOW)
    if hit.result:
        a = _corner(ground.mesh, 3 * hit.face)
        b = _corner(ground.mesh, 3 * hit.face + 1)
        c = _corner(ground.mesh, 3 * hit.face + 2)
        n = wp.normalize(wp.cross(b - a, c - a))
        if n[2] < _ZERO:
            n = -n
        if n[2] > wp.float64(1.0e-3):
            # The sum turns -0.0 into 0.0, as the plane has it.
            s.normal = n + wp.vec3d(_ZERO, _ZERO, _ZERO)
            s.height = a[2] - (n[0] * (p[0] - a[0]) + n[1] * (p[1] - a[1])) / n[2]
            s.grip = ground.grip[hit.face]
    return s


class GroundMesh:
    """Holds a ground's arrays; ``kernel`` is what kernels take."""

    def __init__(
        self, device: wp.Device, points_m: np.ndarray, faces: np.ndarray, grip: np.ndarray
    ):
        """``points_m`` [V, 3], ``faces`` [F, 3], ``grip`` [F]."""
        self._mesh = wp.Mesh(
            wp.array(points_m.astype(np.float32), dtype=wp.vec3, device=device),
            wp.array(faces.astype(np.int32).ravel(), dtype=wp.int32, device=device),
        )
        self.kernel = Ground()
        self.kernel.mesh = self._mesh.id
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
