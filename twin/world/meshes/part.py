"""A piece of a mesh file with one look, as readers give it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from twin.world.meshes.details import EMISSION, MAPS, NORMAL, SHINE

CUTOFF_MAX = 256.0
"""Above all alpha: nothing is there."""
_FLAT_COSINE = 0.99999


@dataclass(slots=True)
class Part:
    """A piece of a file with one look, in the file's own axes and units.

    Parts that share a picture share the array.
    """

    points: np.ndarray
    """float64 [V, 3]"""
    faces: np.ndarray
    """int64 [F, 3]"""
    color: np.ndarray
    """float64 [F, 3], linear RGB; of textured faces, the texture's mean colour."""
    uv: np.ndarray | None = None
    """float64 [V, 2]"""
    image: np.ndarray | None = None
    """uint8 [h, w, 3], sRGB."""
    wrap: list[int] = field(default_factory=lambda: [0, 0])
    """What its images do beyond their borders along u and v, see
    :mod:`twin.world.meshes.details`."""
    colors: np.ndarray | None = None
    """float64 [V, 3], linear RGB of the vertices, times the material's factor unless the image
    has it; None: those of the faces will do."""
    normals: np.ndarray | None = None
    """float64 [V, 3], unit; None: faces are flat."""
    tangents: np.ndarray | None = None
    """float64 [V, 4], unit and 1 or -1, where there is a normal map; None: those of ``uv``."""
    alpha: np.ndarray | None = None
    """uint8 [h, w]; nothing is there where it lies below ``cutoff``."""
    cutoff: float = 0.0
    """0..255"""
    emission: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Linear RGB in the file's own unit, see docs/scene.md."""
    metallic: float = 0.0
    roughness: float = 1.0
    normal_scale: float = 1.0
    maps: list[np.ndarray | None] = field(default_factory=lambda: [None] * MAPS)
    """uint8 [h, w, 3]: emission (sRGB), normals, shine."""
    map_wraps: list[list[int]] = field(default_factory=lambda: [[0, 0] for _ in range(MAPS)])
    map_from_uv: np.ndarray = field(default_factory=lambda: np.tile(np.eye(2, 3), (MAPS, 1, 1)))
    """Coordinates in the maps from ``uv``, float64 [3, 2, 3]."""


def simplify(part: Part) -> list[str]:
    """Take out of a checked part what changes nothing; what could not be used, a word each."""
    broken = []
    for name in ("normals", "tangents", "colors", "uv"):
        values = getattr(part, name)
        if values is not None and not np.isfinite(values).all():
            setattr(part, name, None)
            broken.append(name)
    if part.uv is None:
        part.image, part.alpha, part.maps = None, None, [None] * MAPS
    if part.alpha is not None and part.alpha.min() >= part.cutoff:
        part.alpha = None
    if part.colors is not None and part.image is None:
        corners = part.colors[part.faces]
        if np.array_equal(corners, np.broadcast_to(corners[:, :1], corners.shape)):
            part.colors = None
    if not any(part.emission):
        part.maps[EMISSION] = None
    if part.normals is not None:
        _unit_normals(part)
    if part.maps[NORMAL] is None:
        part.tangents = None
    shine = part.maps[SHINE]
    if shine is not None and (shine[..., 1:] == 255).all():
        part.maps[SHINE] = None
    return broken


def _unit_normals(part: Part) -> None:
    """Normals of length 1, those of length 0 from the faces; none where they are the faces' own."""
    assert part.normals is not None
    length = np.linalg.norm(part.normals, axis=1, keepdims=True)
    own = face_normals(part.points, part.faces)
    unit = np.where(
        length > 1e-12,
        part.normals / np.maximum(length, 1e-12),
        vertex_normals(part.points, part.faces),
    )
    cosine = np.abs((unit[part.faces] * own[:, None]).sum(axis=2))
    part.normals = unit if (cosine < _FLAT_COSINE).any() else None


def face_normals(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals of faces with an area [F, 3]."""
    a, b, c = points[faces].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)


def vertex_normals(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit means of the normals of each vertex's faces, weighted by area [V, 3]; up where there is
    none."""
    a, b, c = points[faces].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    total = np.zeros((len(points), 3))
    for corner in range(3):
        np.add.at(total, faces[:, corner], normal)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(length > 1e-300, total / np.maximum(length, 1e-300), (0.0, 0.0, 1.0))
