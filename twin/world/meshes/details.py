"""What faces from files have beside one colour and one image: normals, colours and tangents of
their corners, and materials with holes, maps and a light of their own.

Only faces that have any of it take a row here; a generated street has none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

REPEAT, CLAMP, MIRRORED = range(3)
"""What an image does beyond its borders, along one axis."""
DATA = 16
"""Bit of an image's kind: its bytes are numbers, not sRGB."""
EMISSION, NORMAL, SHINE = range(3)
"""Places of a material's maps: own light; normals in tangent space; roughness in green and
metalness in blue."""
MAPS = 3
SAME = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
"""Coordinates that are those of the face."""

SHARP_TO, MATT_FROM = 0.1, 0.6
"""Roughness up to which a surface mirrors all that its reflectance says, and from which on it
mirrors nothing and is matt."""
MIRROR_MIN = 0.01
"""Weaker mirrors show the sky alone: they are worth no ray [-]."""
DIELECTRIC = 0.04
"""Reflectance at normal incidence of what is no metal (glTF 2.0, B.3.1) [-]."""


def texture_kind(u: int, v: int, *, data: bool = False) -> int:
    """Kind of an image of a world: what it does along u and v, and what its bytes are."""
    return u | v << 2 | (DATA if data else 0)


def wrapped(values: np.ndarray, mode: int) -> np.ndarray:
    """Texture coordinates of one axis, brought into 0..1 as the image does beyond its borders."""
    if mode == CLAMP:
        return np.clip(values, 0.0, 1.0)
    if mode == MIRRORED:
        return 1.0 - np.abs(values - 2.0 * np.floor(values / 2.0) - 1.0)
    return values - np.floor(values)


@dataclass(frozen=True, slots=True)
class Mask:
    """Alpha of an image: nothing is there where it lies below a limit."""

    alpha: np.ndarray
    """uint8 [h, w], the first row on top."""
    cutoff: float
    """The limit, 0..255."""
    kind: int = 0
    """What it does beyond its borders, :func:`texture_kind`."""


@dataclass(frozen=True, slots=True)
class FaceLook:
    """A material from a file; images are numbers of the world's list, -1: none."""

    mask: int = -1
    """Number in the world's list of masks."""
    bordered: bool = False
    """Its image of colours does something else than repeat."""
    smooth: bool = False
    """Its faces have normals at their corners."""
    colored: bool = False
    """Its faces have colours at their corners, which take the place of the face's colour."""
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Own luminance, linear RGB [cd/m^2]."""
    metallic: float = 0.0
    roughness: float = 1.0
    normal_scale: float = 1.0
    """Factor of x and y of the normal map."""
    maps: tuple[int, int, int] = (-1, -1, -1)
    """Images by :data:`EMISSION`, :data:`NORMAL` and :data:`SHINE`."""
    map_from_uv: tuple[tuple[float, ...], ...] = (SAME,) * MAPS
    """Coordinates in each map from those of the face: rows of a matrix [2, 3]."""
    mirrors: bool = False
    """Some of it mirrors strongly enough to be worth a ray."""


@dataclass(frozen=True, slots=True)
class FaceDetails:
    """Arrays of the F faces of a mesh, R of which have a row; what no row needs is empty."""

    row: np.ndarray
    """int32 [F], row in the other arrays; -1: the face has none."""
    look: np.ndarray
    """int32 [R], number in the world's list of looks."""
    normal: np.ndarray
    """float32 [R or 0, 3, 3], unit normals of the corners, on the side of the face's own."""
    color: np.ndarray
    """float32 [R or 0, 3, 3], linear RGB of the corners."""
    tangent: np.ndarray
    """float32 [R or 0, 3, 4]: unit direction of growing u at the corners, and 1 or -1: the
    direction of growing v is this times normal x tangent; 0: there is none."""

    @property
    def bytes(self) -> int:
        """Memory that the rows take on a device, with what is derived from them [bytes]."""
        arrays = (self.look, self.normal, self.color, self.tangent)
        return sum(array.nbytes for array in arrays) + self.normal.nbytes * 2 // 3


@dataclass(frozen=True, slots=True)
class CornerDetails:
    """Details of faces that are added to a mesh together."""

    look: int
    """Number in the world's list of looks."""
    normals: np.ndarray | None = None
    """float64 [V, 3], unit."""
    colors: np.ndarray | None = None
    """float64 [V, 3], linear RGB."""
    tangents: np.ndarray | None = None
    """float64 [V, 4]"""


@dataclass(slots=True)
class DetailsBuilder:
    """Collects the details of a mesh that grows."""

    _faces: int = 0
    _parts: list[tuple[int, CornerDetails, np.ndarray, np.ndarray]] = field(default_factory=list)

    def add(self, points: np.ndarray, faces: np.ndarray, details: CornerDetails | None) -> None:
        """Count ``faces`` [f, 3] over ``points`` [v, 3], and keep what they have."""
        if details is not None:
            self._parts.append((self._faces, details, points, faces))
        self._faces += len(faces)

    def build(self) -> FaceDetails | None:
        """The details; None: no face has any."""
        if not self._parts:
            return None
        row = np.full(self._faces, -1, np.int32)
        count = 0
        for first, _, _, faces in self._parts:
            row[first : first + len(faces)] = count + np.arange(len(faces))
            count += len(faces)
        looks = [np.full(len(f), d.look, np.int32) for _, d, _, f in self._parts]
        normals = [
            None if d.normals is None else _sided(d.normals[f], p[f]) for _, d, p, f in self._parts
        ]
        colors = [None if d.colors is None else d.colors[f] for _, d, _, f in self._parts]
        tangents = [None if d.tangents is None else d.tangents[f] for _, d, _, f in self._parts]
        counts = [len(f) for _, _, _, f in self._parts]
        return FaceDetails(
            row,
            np.concatenate(looks),
            _whole(normals, counts, 3),
            _whole(colors, counts, 3),
            _whole(tangents, counts, 4),
        )


def _whole(parts: Sequence[np.ndarray | None], counts: list[int], width: int) -> np.ndarray:
    """One array of all parts, zeros where one has none; empty if none has any."""
    if all(part is None for part in parts):
        return np.zeros((0, 3, width), np.float32)
    rows = [
        np.zeros((count, 3, width)) if part is None else part
        for part, count in zip(parts, counts, strict=True)
    ]
    return np.concatenate(rows).astype(np.float32)


def _sided(normals: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Normals of corners [F, 3, 3], turned over where they lie behind their faces."""
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    behind = (normals.sum(axis=1) * face).sum(axis=1) < 0.0
    return np.where(behind[:, None, None], -normals, normals)


def tangents_of(
    points: np.ndarray, faces: np.ndarray, uv: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """Tangents from the derivatives of texture coordinates, means of a vertex's faces [V, 4].

    Lengyel, Foundations of Game Engine Development 2 (2019), 7.5.

    Args:
        points: [V, 3].
        faces: [F, 3].
        uv: u to the right and v up, [V, 2].
        normals: unit, [V, 3].
    """
    p, q = points[faces], uv[faces]
    e1, e2 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    (x1, y1), (x2, y2) = (q[:, 1] - q[:, 0]).T, (q[:, 2] - q[:, 0]).T
    det = x1 * y2 - x2 * y1
    sign = np.sign(det)[:, None]  # by area: tiny images of a face would outweigh all others
    along_u = (e1 * y2[:, None] - e2 * y1[:, None]) * sign
    along_v = (e2 * x1[:, None] - e1 * x2[:, None]) * sign
    u, v = np.zeros((2, len(points), 3))
    for corner in range(3):
        np.add.at(u, faces[:, corner], along_u)
        np.add.at(v, faces[:, corner], along_v)
    tangent = u - normals * (normals * u).sum(axis=1, keepdims=True)
    length = np.linalg.norm(tangent, axis=1, keepdims=True)
    there = length > 1e-12 * np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-30)
    tangent = np.where(there, tangent / np.maximum(length, 1e-30), 0.0)
    turn = np.where((np.cross(normals, tangent) * v).sum(axis=1) < 0.0, -1.0, 1.0)
    return np.concatenate([tangent, np.where(there, turn[:, None], 0.0)], axis=1)


def sharp_share(roughness: np.ndarray | float) -> np.ndarray:
    """Share of the mirrored light that makes an image, falling with roughness; the rest is matt."""
    line = (MATT_FROM - np.asarray(roughness)) / (MATT_FROM - SHARP_TO)
    return np.clip(line, 0.0, 1.0) ** 2
