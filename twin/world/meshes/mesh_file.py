"""Meshes from files, read and checked: OBJ, PLY and STL by trimesh, glTF and GLB by
:mod:`twin.world.meshes.gltf`.

Scanned meshes bring vertex colours or a texture with them: textures stay images of at most
:data:`twin.world.meshes.part_images.TEXTURE_SIDE_MAX` pixels a side.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from schemas.files.assets import mesh_files
from schemas.files.regular_file import open_regular
from twin.world.meshes.gltf.document import GltfError
from twin.world.meshes.gltf.parts import gltf_part
from twin.world.meshes.gltf.reader import read_pieces
from twin.world.meshes.mesh_header import FACES_MAX, FILE_BYTES_MAX, SUFFIXES, declared_faces
from twin.world.meshes.others import Beside, stream_of
from twin.world.meshes.part import Part as Part
from twin.world.meshes.part import simplify
from twin.world.meshes.part_images import TEXTURES_MAX, PartImages
from twin.world.meshes.srgb import linear

_AREA_MIN = 1e-12  # of the mean square edge
_GREY = 0.35


@dataclass(slots=True)
class MeshData:
    """What was read from a file."""

    parts: list[Part]
    notes: list[str] = field(default_factory=list)


def load_mesh(path: Path) -> MeshData:
    """Read and check a mesh file.

    Raises:
        ValueError: one line that names the file: not there, not a mesh, too large, NaN, no faces,
            a face that names a vertex that is not there.
    """
    check_before(path)
    data = MeshData([])
    images = PartImages(path, data.notes)
    if path.suffix.lower() in (".glb", ".gltf"):
        parts = _gltf_parts(path, data.notes, images)
    else:
        parts = _other_parts(path, images)
    faces = dropped = 0
    broken: list[str] = []
    for part in parts:
        dropped += _check(part, path)
        faces += len(part.faces)
        if faces > FACES_MAX:
            raise ValueError(f"{path}: more than {FACES_MAX} faces, simplify the mesh first")
        if len(part.faces):
            broken += [name for name in simplify(part) if name not in broken]
            data.parts.append(part)
    if not faces:
        why = f" left: all {dropped} have no area" if dropped else ""
        raise ValueError(f"{path}: the mesh has no faces{why}")
    if dropped:
        data.notes.append(f"{path.name}: {dropped} faces without area left out")
    if broken:
        what = ", ".join("texture coordinates" if name == "uv" else name for name in broken)
        data.notes.append(f"{path.name}: {what} that are NaN or infinite ignored")
    if images.colors > TEXTURES_MAX:
        raise ValueError(f"{path}: {images.colors} textures, allowed: {TEXTURES_MAX}")
    return data


def check_before(path: Path) -> None:
    """Refuse by name, size and header what need not be loaded; everything that is no regular file.

    Raises:
        ValueError: as :func:`load_mesh`.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{path}: not a mesh format; allowed: {', '.join(SUFFIXES)}")
    try:
        if path.is_dir():
            raise ValueError(f"{path}: a folder, needed a mesh file")
        open_regular(path).close()
        size = path.stat().st_size
        if not size:
            raise ValueError(f"{path}: the file is empty")
        declared = declared_faces(path)
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror or error}") from None
    except ValueError as error:
        text = str(error)
        raise ValueError(text if str(path) in text else f"{path}: {text}") from None
    if declared is not None and declared > FACES_MAX:
        raise ValueError(f"{path}: {declared} faces, at most {FACES_MAX}; simplify the mesh first")
    if size > FILE_BYTES_MAX:
        raise ValueError(f"{path}: {size} bytes, at most {FILE_BYTES_MAX}; simplify the mesh first")
    for file in mesh_files(path)[1:]:
        _check_named(file, path)


def _check_named(file: Path, path: Path) -> None:
    """Refuse a file that the mesh ``path`` names and trimesh would read: a device, a pipe, an
    oversized file."""
    try:
        if not file.exists() or file.is_dir():
            return
    except (OSError, ValueError):
        return  # no name of a file
    try:
        open_regular(file, FILE_BYTES_MAX).close()
    except OSError as error:
        raise ValueError(f"{path}: it names {file}: {error.strerror or error}") from None


def _read(path: Path, notes: list[str]) -> list[tuple[Any, Any]]:
    """Geometries of a file, moved to where the file's nodes put them, and normals [V, 3] of those
    that have some in the file, else None."""
    import trimesh  # heavy, and most scenes have no mesh files

    log = logging.getLogger("trimesh")
    before = log.level
    log.setLevel(logging.CRITICAL)  # it logs what it raises
    try:
        beside = Beside(path)
        scene = trimesh.load_scene(
            stream_of(path),
            file_type=path.suffix.lower()[1:],
            resolver=beside,
            process=False,
            validate=False,
        )
        notes += dict.fromkeys(beside.missing)
        geometries = []
        for geometry in scene.dump(concatenate=False):
            source = scene.geometry.get(geometry.metadata.get("name"))
            # The property makes them up where the file has none.
            normals = None if source is None else source._cache.cache.get("vertex_normals")
            geometries.append((geometry, normals))
        return geometries
    except MemoryError:
        raise ValueError(f"{path}: not enough memory to load it") from None
    except Exception as error:  # its loaders raise whatever their parsers do
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path}: cannot be read as a mesh: {reason[:160]}") from None
    finally:
        log.setLevel(before)


def _other_parts(path: Path, images: PartImages) -> Iterator[Part]:
    """What trimesh reads."""
    for geometry, normals in _read(path, images.notes):
        if hasattr(geometry, "faces"):
            faces = np.asarray(geometry.faces, np.int64).reshape(-1, 3)
            part = _look(geometry, faces, images)
            part.points = np.asarray(geometry.vertices, np.float64)
            if normals is not None and np.shape(normals) == part.points.shape:
                part.normals = np.array(normals, np.float64)
            yield part


def _gltf_parts(path: Path, notes: list[str], images: PartImages) -> Iterator[Part]:
    """What a glTF file holds."""
    try:
        pieces, ignored = read_pieces(path)
    except (GltfError, OSError, RecursionError) as error:
        reason = " ".join(str(getattr(error, "strerror", None) or error).split())
        raise ValueError(f"{path}: cannot be read as a mesh: {reason[:200]}") from None
    except MemoryError:
        raise ValueError(f"{path}: not enough memory to load it") from None
    notes += ignored
    gone = 0
    for piece in pieces:
        if piece.look.cutoff > 0.0 and piece.look.alpha < piece.look.cutoff:
            gone += 1
        else:
            yield gltf_part(piece, images)
    if gone:
        notes.append(f"{path.name}: parts that are transparent throughout left out")


def _named_are_there(faces: np.ndarray, count: int) -> bool:
    return not len(faces) or bool(faces.min() >= 0 and faces.max() < count)


def _check(part: Part, path: Path) -> int:
    """Refuse a part with broken numbers; take faces without area out and count them."""
    points, faces = part.points, part.faces
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{path}: vertices of shape {list(points.shape)}, needed x, y, z each")
    if not np.isfinite(points).all():
        bad = int((~np.isfinite(points)).any(axis=1).sum())
        raise ValueError(f"{path}: {bad} vertices are NaN or infinite")
    if not _named_are_there(faces, len(points)):
        bad = int(((faces < 0) | (faces >= len(points))).any(axis=1).sum())
        raise ValueError(
            f"{path}: {bad} faces name vertices that are not there (it has {len(points)})"
        )
    corners = points[faces]
    edges = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.linalg.norm(np.cross(*edges), axis=1)
    longest = np.maximum(*((e * e).sum(axis=1) for e in edges))
    keep = area > _AREA_MIN * np.maximum(longest, 1e-30)
    part.faces, part.color = faces[keep], part.color[keep]
    return int((~keep).sum())


def _look(geometry: Any, faces: np.ndarray, images: PartImages) -> Part:
    """Colours and texture of a geometry."""
    visual = geometry.visual
    kind = getattr(visual, "kind", None)
    part = Part(np.zeros((0, 3)), faces, np.full((len(faces), 3), _GREY))
    if kind == "vertex":
        rgb = np.asarray(visual.vertex_colors, np.float64)[:, :3] / 255.0
        part.colors = linear(rgb)  # scanners write sRGB
        part.color = part.colors[faces].mean(axis=1)
    elif kind == "face":
        part.color = linear(np.asarray(visual.face_colors, np.float64)[:, :3] / 255.0)
    elif kind == "texture":
        image, factor = _material(visual.material)
        uv = getattr(visual, "uv", None)
        if image is not None and uv is not None and np.isfinite(uv).all():
            part.image = images.color(image, factor)
            part.uv = np.asarray(uv, np.float64)
            mean = linear(part.image.reshape(-1, 3) / 255.0).mean(axis=0)
            part.color = np.broadcast_to(mean, (len(faces), 3)).copy()
        elif factor is not None:
            part.color = np.broadcast_to(factor, (len(faces), 3)).copy()
    return part


def _material(material: Any) -> tuple[Any, np.ndarray | None]:
    """Image (PIL) and linear colour of a trimesh material, each None if it has none."""
    image = getattr(material, "baseColorTexture", None)
    factor = getattr(material, "baseColorFactor", None)
    if factor is not None:
        values = np.asarray(factor, np.float64)[:3]
        # trimesh holds the linear factors of glTF as bytes.
        return image, values / 255.0 if np.asarray(factor).dtype.kind in "ui" else values
    if image is None:
        image = getattr(material, "image", None)
        diffuse = getattr(material, "diffuse", None)
        if image is None and diffuse is not None:
            return None, linear(np.asarray(diffuse, np.float64)[:3] / 255.0)
    return image, None
