"""Triangle meshes with a material, colour, tag and instance for every face."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from schemas.messages import SEMANTIC_CLASSES
from twin.world.meshes import materials
from twin.world.meshes.details import CornerDetails, DetailsBuilder, FaceDetails

Color = tuple[float, float, float]
"""Linear RGB reflectance [-]."""


Bend = Callable[[np.ndarray], np.ndarray]
"""Moves points [n, 3]."""

DECAL = -1
"""Tag of faces that darken or paint what lies under them."""
UV_METRES = -2
"""Texture of what has its patterns not in world coordinates but at uv [m]: ground of a road that
bends, in street coordinates, and walls askew to the world's axes."""


@dataclass(frozen=True, slots=True)
class Mesh:
    """Arrays of a finished mesh: V vertices, F faces."""

    points_m: np.ndarray
    """float32 [V, 3]"""
    faces: np.ndarray
    """int32 [F, 3]"""
    material: np.ndarray
    """int32 [F], see :mod:`twin.world.meshes.materials`"""
    color: np.ndarray
    """float32 [F, 3], linear RGB"""
    tag: np.ndarray
    """int32 [F], the seed of procedural surfaces; :data:`DECAL`: painted on, nothing to stand on"""
    instance: np.ndarray
    """int32 [F], object the face belongs to; -1 for none"""
    semantic: np.ndarray
    """int32 [F], index into :data:`schemas.messages.SEMANTIC_CLASSES`"""
    texture: np.ndarray
    """int32 [F], image of the world's list, which is multiplied with the colour; -1 for none;
    :data:`UV_METRES`"""
    uv: np.ndarray
    """float32 [V, 2], u to the right and v up in the image (row = (1 - v) * height), repeating;
    0 where there is no image"""
    ambient: np.ndarray
    """float32 [V], share of the sky before the face that the vertex sees, 1 in the open; see
    :mod:`twin.world.street.ambient`"""
    details: FaceDetails | None = None
    """What faces from files have beside; None: none has anything"""
    grip: np.ndarray | None = None
    """float64 [F], friction over that of asphalt [-]; NaN: that of the material. None: all have
    that of their material"""


_GRID_PER_M = 65536.0


def _settled(points_m: np.ndarray) -> np.ndarray:
    """float32, on a grid of 15 um: sines that differ in the last bit between processors, as those
    of NumPy may, give the same mesh."""
    return (np.rint(points_m * _GRID_PER_M) / _GRID_PER_M).astype(np.float32)


@dataclass(frozen=True, slots=True)
class _Batch:
    """Faces that were added together; arrays hold one row per face, scalars go for all."""

    count: int
    material: int
    color: Color | np.ndarray
    tag: int | np.ndarray
    instance: int
    semantic: int
    texture: int | np.ndarray
    grip: float


class MeshBuilder:
    """Collects faces; ``place`` and ``label`` act on what is added inside their block."""

    def __init__(self) -> None:
        self._points: list[np.ndarray] = []
        self._faces: list[np.ndarray] = []
        self._uv: list[np.ndarray] = []
        self._batches: list[_Batch] = []
        self._details = DetailsBuilder()
        self._count = 0
        self._yaw = 0.0
        self._offset = np.zeros(3)
        self._instance = -1
        self._semantic = 0
        self._bend: Bend | None = None
        self._grip = math.nan

    @property
    def count(self) -> int:
        """Corners that were added so far."""
        return self._count

    @contextmanager
    def bent(self, bend: Bend | None) -> Iterator[None]:
        """Let ``bend`` move the points that are added inside the block, after their places; where
        they were before are then their street coordinates."""
        before, self._bend = self._bend, bend
        try:
            yield
        finally:
            self._bend = before

    @contextmanager
    def rolled(self, grip: float | None) -> Iterator[None]:
        """Give the ground that is added inside the block a friction over that of asphalt; None:
        that of its material."""
        before, self._grip = self._grip, math.nan if grip is None else grip
        try:
            yield
        finally:
            self._grip = before

    @contextmanager
    def place(
        self,
        x_m: float,
        y_m: float,
        yaw_rad: float = 0.0,
        instance: int | None = None,
        z_m: float = 0.0,
    ) -> Iterator[None]:
        """Move and turn what is added inside the block, and give it an instance.

        Blocks nest: the inner place is one in the axes of the outer one.
        """
        before = (self._yaw, self._offset, self._instance)
        cosine, sine = math.cos(self._yaw), math.sin(self._yaw)
        shift = (cosine * x_m - sine * y_m, sine * x_m + cosine * y_m, z_m)
        self._offset = self._offset + np.array(shift)
        self._yaw += yaw_rad
        self._instance = self._instance if instance is None else instance
        try:
            yield
        finally:
            self._yaw, self._offset, self._instance = before

    @contextmanager
    def label(self, semantic: str, instance: int | None = None) -> Iterator[None]:
        """Give what is added inside the block a class of
        :data:`schemas.messages.SEMANTIC_CLASSES`, and an instance if one is given."""
        before = (self._semantic, self._instance)
        self._semantic = SEMANTIC_CLASSES.index(semantic)
        self._instance = self._instance if instance is None else instance
        try:
            yield
        finally:
            self._semantic, self._instance = before

    def add(
        self,
        points: np.ndarray,
        faces: np.ndarray,
        material: int,
        color: Color | np.ndarray,
        tag: int | np.ndarray = 0,
        *,
        uv: np.ndarray | None = None,
        texture: int | np.ndarray = -1,
        details: CornerDetails | None = None,
    ) -> None:
        """Add ``faces`` [f, 3] over ``points`` [v, 3] with one material.

        Args:
            color: of all faces, or [f, 3].
            tag: of all faces, or [f].
            uv: texture coordinates [v, 2].
            texture: image of all faces, or of each [f].
            details: of the faces, in the axes of the world: places do not turn them.
        """
        points = np.asarray(points, float)
        cosine, sine = math.cos(self._yaw), math.sin(self._yaw)
        moved = points.copy()
        moved[:, 0] = cosine * points[:, 0] - sine * points[:, 1]
        moved[:, 1] = sine * points[:, 0] + cosine * points[:, 1]
        moved += self._offset
        if self._bend is not None:
            uv, texture = moved[:, :2], UV_METRES
            moved = self._bend(moved)
        elif material in materials.WALLS and abs(cosine * sine) > 1e-6:
            uv, texture = np.stack([points[:, 0] + points[:, 1], points[:, 2]], axis=1), UV_METRES
        self._points.append(moved)
        faces = np.asarray(faces, np.int32)
        self._details.add(moved, faces, details)
        self._faces.append(faces + self._count)
        self._uv.append(np.zeros((len(points), 2)) if uv is None else np.asarray(uv, float))
        self._count += len(points)
        self._batches.append(
            _Batch(
                len(faces),
                material,
                color,
                tag,
                self._instance,
                self._semantic,
                texture,
                self._grip,
            )
        )

    def quads(
        self,
        corners: np.ndarray,
        material: int,
        color: Color | np.ndarray,
        tag: int | np.ndarray = 0,
    ) -> None:
        """Flat quadrilaterals [n, 4, 3], each counterclockwise seen from its front.

        ``color`` [n, 3] and ``tag`` [n] may differ between them.
        """
        corners = np.asarray(corners, float).reshape(-1, 4, 3)
        if not len(corners):
            return
        first = 4 * np.arange(len(corners))[:, None]
        faces = np.concatenate(
            [first + np.array((0, 1, 2)), first + np.array((0, 2, 3))], axis=1
        ).reshape(-1, 3)
        if isinstance(color, np.ndarray) and color.ndim == 2:
            color = np.repeat(color, 2, axis=0)
        if isinstance(tag, np.ndarray):
            tag = np.repeat(tag, 2)
        self.add(corners.reshape(-1, 3), faces, material, color, tag)

    def quad(
        self, corners: Sequence[Sequence[float]], material: int, color: Color, tag: int = 0
    ) -> None:
        """A flat quadrilateral; corners counterclockwise seen from its front."""
        self.add(np.asarray(corners, float), np.array([[0, 1, 2], [0, 2, 3]]), material, color, tag)

    def floor(
        self,
        x_m: tuple[float, float],
        y_m: tuple[float, float],
        z_m: float,
        material: int,
        color: Color,
        pitch_m: float = 12.0,
    ) -> None:
        """A level rectangle cut into pieces of at most ``pitch_m``: long faces spoil a BVH."""
        columns = max(1, math.ceil((x_m[1] - x_m[0]) / pitch_m))
        rows = max(1, math.ceil((y_m[1] - y_m[0]) / pitch_m))
        self.grid(np.linspace(*x_m, columns + 1), np.linspace(*y_m, rows + 1), z_m, material, color)

    def grid(self, xs: np.ndarray, ys: np.ndarray, z_m: float, material: int, color: Color) -> None:
        """A level rectangle cut at ``xs`` and ``ys``, both growing."""
        columns, rows = len(xs) - 1, len(ys) - 1
        points = np.stack(
            [*np.meshgrid(xs, ys, indexing="ij"), np.full((len(xs), len(ys)), z_m)], -1
        )
        i, j = (a.ravel() for a in np.meshgrid(range(columns), range(rows), indexing="ij"))
        a, b = i * (rows + 1) + j, (i + 1) * (rows + 1) + j
        faces = np.concatenate([np.stack([a, b, b + 1], 1), np.stack([a, b + 1, a + 1], 1)])
        self.add(points.reshape(-1, 3), faces, material, color)

    def box(
        self,
        low: Sequence[float],
        high: Sequence[float],
        material: int,
        color: Color,
        tag: int = 0,
        top: tuple[int, Color] | None = None,
    ) -> None:
        """An upright box without a bottom; ``top`` may have its own material and colour."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        self.quad([(x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)], material, color, tag)
        self.quad([(x1, y1, z0), (x0, y1, z0), (x0, y1, z1), (x1, y1, z1)], material, color, tag)
        self.quad([(x0, y1, z0), (x0, y0, z0), (x0, y0, z1), (x0, y1, z1)], material, color, tag)
        self.quad([(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)], material, color, tag)
        lid = top or (material, color)
        self.quad([(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)], *lid, tag)

    def tube(
        self,
        start: Sequence[float],
        end: Sequence[float],
        radius_m: tuple[float, float],
        sides: int,
        material: int,
        color: Color,
    ) -> None:
        """A tapering tube from ``start`` to ``end``."""
        a, b = np.asarray(start, float), np.asarray(end, float)
        axis = (b - a) / np.linalg.norm(b - a)
        side = np.cross(axis, (0.0, 0.0, 1.0) if abs(axis[2]) < 0.9 else (1.0, 0.0, 0.0))
        side /= np.linalg.norm(side)
        up = np.cross(axis, side)
        angle = 2.0 * np.pi * np.arange(sides) / sides
        ring = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up
        points = np.concatenate([a + radius_m[0] * ring, b + radius_m[1] * ring])
        i = np.arange(sides)
        j = (i + 1) % sides
        faces = [np.stack([i, j, j + sides], 1), np.stack([i, j + sides, i + sides], 1)]
        self.add(points, np.concatenate(faces), material, color)

    def polygon(
        self, outline: np.ndarray, x_m: float, material: int, color: Color, front: float = -1.0
    ) -> None:
        """An upright convex polygon that faces -x (``front`` -1) or +x (1).

        ``outline`` [n, 2]: to the right and up as seen from its front [m], any turn.
        """
        outline = np.asarray(outline, float)
        turned = np.roll(outline, -1, axis=0)
        if (outline[:, 0] * turned[:, 1] - turned[:, 0] * outline[:, 1]).sum() < 0:
            outline = outline[::-1]
        points = np.stack(
            [np.full(len(outline), x_m), front * outline[:, 0], outline[:, 1]], axis=1
        )
        fan = np.array([(0, i, i + 1) for i in range(1, len(outline) - 1)])
        self.add(points, fan, material, color)

    def disc(
        self,
        centre: Sequence[float],
        radius_m: float,
        sign: float,
        sides: int,
        material: int,
        color: Color,
    ) -> None:
        """An upright disc that faces +y (``sign`` 1) or -y (``sign`` -1)."""
        angle = 2.0 * np.pi * np.arange(sides) / sides
        ring = np.stack([np.sin(angle) * sign, np.zeros(sides), np.cos(angle)], 1) * radius_m
        fan = np.array([(0, i, i + 1) for i in range(1, sides - 1)])
        self.add(np.asarray(centre, float) + ring, fan, material, color)

    def build(self) -> Mesh:
        """The finished mesh, in the open."""
        batches = self._batches

        def spread(name: str, dtype: type, width: tuple[int, ...] = ()) -> np.ndarray:
            rows = [
                np.broadcast_to(np.asarray(getattr(b, name), dtype), (b.count, *width))
                for b in batches
            ]
            return np.concatenate(rows)

        return Mesh(
            points_m=_settled(np.concatenate(self._points)),
            faces=np.concatenate(self._faces).astype(np.int32),
            material=spread("material", np.int32),
            color=spread("color", np.float32, (3,)),
            tag=spread("tag", np.int32),
            instance=spread("instance", np.int32),
            semantic=spread("semantic", np.int32),
            texture=spread("texture", np.int32),
            uv=np.concatenate(self._uv).astype(np.float32),
            ambient=np.ones(self._count, np.float32),
            details=self._details.build(),
            grip=None if all(math.isnan(b.grip) for b in batches) else spread("grip", np.float64),
        )
