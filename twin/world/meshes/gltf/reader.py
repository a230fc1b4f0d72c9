"""Pieces of a glTF file where its scene puts them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from twin.world.meshes.details import MAPS
from twin.world.meshes.gltf.accessors import array
from twin.world.meshes.gltf.document import Document, GltfError, open_gltf
from twin.world.meshes.gltf.looks import GltfLook, look_of, read_picture
from twin.world.meshes.gltf.maps import map_from_map
from twin.world.meshes.gltf.nodes import PlacedMesh, placed_meshes, world_of_nodes
from twin.world.meshes.gltf.primitives import Primitive, read_primitive


@dataclass(slots=True)
class GltfPiece:
    """A primitive in the scene's axes."""

    points: np.ndarray
    """float64 [V, 3]"""
    faces: np.ndarray
    """int64 [F, 3], anticlockwise from outside; not yet checked against the points."""
    look: GltfLook
    """Its material."""
    factor: np.ndarray
    """Linear RGB of its material, float64 [3]."""
    colors: np.ndarray | None = None
    """Linear RGB of the vertices, float64 [V, 3]."""
    normals: np.ndarray | None = None
    """Of the vertices, float64 [V, 3], of any length."""
    tangents: np.ndarray | None = None
    """Of the vertices, float64 [V, 4]; the last: 1, or -1 where v is mirrored."""
    uv: np.ndarray | None = None
    """In the picture of its first map, u to the right and v up, float64 [V, 2]."""
    picture: Image.Image | None = None
    """Base colour; pieces that share it share the object."""
    maps: list[Image.Image | None] = field(default_factory=lambda: [None] * MAPS)
    """Pictures of its other maps, by their place in the material."""
    map_from_uv: np.ndarray = field(default_factory=lambda: np.tile(np.eye(2, 3), (MAPS, 1, 1)))
    """Coordinates in the other maps from ``uv``, float64 [3, 2, 3]."""


def read_pieces(path: Path) -> tuple[list[GltfPiece], list[str]]:
    """Everything with triangles in the default scene, and what was left out, one line each.

    Raises:
        GltfError: the file cannot be read; one line without its name.
        OSError: it, or a file that it names, cannot be read.
    """
    document = open_gltf(path)
    for key in ("animations", "cameras"):
        if document.rows(key):
            document.note(f"{key} ignored")
    pictures: dict[int, Image.Image] = {}
    pieces = [
        piece for placed in placed_meshes(document) for piece in _pieces(document, placed, pictures)
    ]
    return pieces, list(document.notes)


def _pieces(
    document: Document, placed: PlacedMesh, pictures: dict[int, Image.Image]
) -> list[GltfPiece]:
    mesh = document.row("meshes", placed.mesh)
    rows = mesh.get("primitives")
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise GltfError(f"meshes[{placed.mesh}] has no list of primitives")
    weights = placed.weights or mesh.get("weights")
    found = []
    for row in rows:
        look = look_of(document, row.get("material"))
        primitive = read_primitive(document, row, _wanted(look))
        if primitive is not None:
            _morph(document, row, weights, primitive)
            piece = _piece(document, placed, primitive, look, pictures)
            if piece.colors is not None and "material" not in row:
                piece.factor = np.ones(3)
            found.append(piece)
    return found


def _wanted(look: GltfLook) -> tuple[str, ...]:
    names = ["NORMAL", "TANGENT", "COLOR_0", "JOINTS_0", "WEIGHTS_0"]
    return (*names, look.first_map.texcoord) if look.first_map is not None else tuple(names)


def _piece(
    document: Document,
    placed: PlacedMesh,
    primitive: Primitive,
    look: GltfLook,
    pictures: dict[int, Image.Image],
) -> GltfPiece:
    moves, points = _moved(document, placed, primitive)
    mirrored = len(moves) == 1 and bool(np.linalg.det(moves[0]) < 0)
    faces = primitive.faces[:, ::-1] if mirrored else primitive.faces
    piece = GltfPiece(points, faces, look, look.factor)
    colors = primitive.attributes.get("COLOR_0")
    if colors is not None and colors.ndim == 2 and colors.shape[1] in (3, 4):
        piece.colors = colors[:, :3]
        if look.cutoff > 0.0 and colors.shape[1] == 4 and (colors[:, 3] < 1.0).any():
            document.note("alpha of vertex colours ignored")
    normals = primitive.attributes.get("NORMAL")
    if normals is not None and normals.shape == points.shape:
        piece.normals = _turned(_cofactors(moves), normals)
        tangents = primitive.attributes.get("TANGENT")
        if tangents is not None and tangents.shape == (len(points), 4):
            piece.tangents = np.concatenate([_turned(moves, tangents[:, :3]), tangents[:, 3:]], 1)
            piece.tangents[:, 3] *= -1.0 if mirrored else 1.0
    _show_maps(document, primitive, piece, pictures)
    return piece


def _show_maps(
    document: Document, primitive: Primitive, piece: GltfPiece, pictures: dict[int, Image.Image]
) -> None:
    """Give a piece its pictures and their coordinates."""
    look, first = piece.look, piece.look.first_map
    if first is None:
        return
    uv = primitive.attributes.get(first.texcoord)
    if uv is None:
        document.note(f"a texture without {first.texcoord} ignored")
        return
    uv = uv[:, :2] @ first.uv_from[:, :2].T + first.uv_from[:, 2]
    piece.uv = np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)

    def picture(index: int) -> Image.Image:
        if index not in pictures:
            pictures[index] = read_picture(document, index)
        return pictures[index]

    if look.base is not None:
        piece.picture = picture(look.base.image)
    for place, found in enumerate(look.maps):
        if found is None:
            continue
        matrix = map_from_map(found, first)
        if matrix is None:
            document.note("a map with other coordinates than the material's first ignored")
            continue
        piece.maps[place], piece.map_from_uv[place] = picture(found.image), matrix


def _moved(
    document: Document, placed: PlacedMesh, primitive: Primitive
) -> tuple[np.ndarray, np.ndarray]:
    """Linear parts of what moves the points, [1, 3, 3] or [V, 3, 3], and the points in the
    scene."""
    matrix = placed.from_mesh
    joints = primitive.attributes.get("JOINTS_0")
    weights = primitive.attributes.get("WEIGHTS_0")
    if placed.skin is None or joints is None or weights is None:
        return matrix[None, :3, :3], primitive.points @ matrix[:3, :3].T + matrix[:3, 3]
    bones = _bones(document, placed.skin)
    if joints.max(initial=0) >= len(bones):
        raise GltfError("a vertex names a joint that is not there")
    blend = np.einsum("vj,vjrc->vrc", weights, bones[joints.astype(np.int64)])
    points = np.einsum("vrc,vc->vr", blend[:, :3, :3], primitive.points) + blend[:, :3, 3]
    return blend[:, :3, :3], points


def _turned(moves: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors [V, 3] after one matrix each, or one for all."""
    return np.einsum("vrc,vc->vr", np.broadcast_to(moves, (len(vectors), 3, 3)), vectors)


def _cofactors(moves: np.ndarray) -> np.ndarray:
    """What turns normals as ``moves`` [N, 3, 3] move points: inverse and transposed, times the size
    of the determinant, so that it is there of flat ones as well."""
    a, b, c = moves[:, 0], moves[:, 1], moves[:, 2]
    found = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    return np.where(np.linalg.det(moves) < 0.0, -1.0, 1.0)[:, None, None] * found


def _bones(document: Document, index: int) -> np.ndarray:
    """World from mesh of each joint as the nodes stand, [J, 4, 4] (glTF 2.0, 3.7.3)."""
    skin = document.row("skins", index)
    world = world_of_nodes(document)
    joints = skin.get("joints")
    if not isinstance(joints, list) or not all(joint in world for joint in joints):
        raise GltfError(f"skins[{index}] has joints that are not in the scene")
    bones = np.array([world[joint] for joint in joints])
    if "inverseBindMatrices" in skin:
        inverse = array(document, skin["inverseBindMatrices"])
        if inverse.shape != (len(joints), 16):
            raise GltfError(f"skins[{index}] has matrices for other joints")
        bones = bones @ inverse.reshape(-1, 4, 4).transpose(0, 2, 1)
    return bones


def _morph(document: Document, row: dict[str, Any], weights: object, primitive: Primitive) -> None:
    """Add morph targets with the weights at rest."""
    targets = row.get("targets", [])
    if not isinstance(weights, list) or not isinstance(targets, list):
        return
    for weight, target in zip(weights, targets, strict=False):
        if not weight or not isinstance(target, dict):
            continue
        if "POSITION" in target:
            moved = array(document, target["POSITION"])
            if moved.shape != primitive.points.shape:
                raise GltfError("a morph target has another number of points")
            primitive.points += float(weight) * moved
        normals = primitive.attributes.get("NORMAL")
        if "NORMAL" in target and normals is not None:
            turned = array(document, target["NORMAL"])
            if turned.shape != normals.shape:
                raise GltfError("a morph target has another number of normals")
            normals += float(weight) * turned
