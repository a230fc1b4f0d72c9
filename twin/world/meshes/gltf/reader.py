"""Pieces of a glTF file where its scene puts them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from twin.world.meshes.gltf.accessors import array
from twin.world.meshes.gltf.document import Document, GltfError, open_gltf
from twin.world.meshes.gltf.looks import GltfLook, look_of, read_picture
from twin.world.meshes.gltf.nodes import PlacedMesh, placed_meshes, world_of_nodes
from twin.world.meshes.gltf.primitives import Primitive, read_primitive


@dataclass(slots=True)
class GltfPiece:
    """A primitive in the scene's axes."""

    points: np.ndarray
    """float64 [V, 3]"""
    faces: np.ndarray
    """int64 [F, 3], anticlockwise from outside; not yet checked against the points."""
    factor: np.ndarray
    """Linear RGB of its material, float64 [3]."""
    colors: np.ndarray | None
    """Linear RGB of the vertices, float64 [V, 3]."""
    uv: np.ndarray | None
    """In the picture, u to the right and v up, float64 [V, 2]."""
    picture: Image.Image | None
    """RGB; pieces that share it share the object."""


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
    names = ["COLOR_0", "JOINTS_0", "WEIGHTS_0"]
    return (*names, look.texcoord) if look.image is not None else tuple(names)


def _piece(
    document: Document,
    placed: PlacedMesh,
    primitive: Primitive,
    look: GltfLook,
    pictures: dict[int, Image.Image],
) -> GltfPiece:
    points, mirrored = _moved(document, placed, primitive)
    faces = primitive.faces[:, ::-1] if mirrored else primitive.faces
    colors = primitive.attributes.get("COLOR_0")
    uv = primitive.attributes.get(look.texcoord)
    picture = None
    if look.image is not None and uv is None:
        document.note(f"a texture without {look.texcoord} ignored")
    elif look.image is not None and uv is not None:
        if look.image not in pictures:
            pictures[look.image] = read_picture(document, look.image)
        picture = pictures[look.image]
        uv = uv[:, :2] @ look.uv_from[:, :2].T + look.uv_from[:, 2]
        if not look.repeats and (uv.min() < -1e-6 or uv.max() > 1 + 1e-6):
            document.note("a texture that ends at its border repeats")
        if colors is not None:
            document.note("vertex colours under a texture ignored")
        uv = np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)
    return GltfPiece(
        points,
        faces,
        look.factor,
        colors[:, :3] if colors is not None and colors.ndim == 2 else None,
        uv if picture is not None else None,
        picture,
    )


def _moved(document: Document, placed: PlacedMesh, primitive: Primitive) -> tuple[np.ndarray, bool]:
    """Points in the scene, and whether they are mirrored."""
    matrix = placed.from_mesh
    joints = primitive.attributes.get("JOINTS_0")
    weights = primitive.attributes.get("WEIGHTS_0")
    if placed.skin is None or joints is None or weights is None:
        points = primitive.points @ matrix[:3, :3].T + matrix[:3, 3]
        return points, bool(np.linalg.det(matrix[:3, :3]) < 0)
    bones = _bones(document, placed.skin)
    if joints.max(initial=0) >= len(bones):
        raise GltfError("a vertex names a joint that is not there")
    blend = np.einsum("vj,vjrc->vrc", weights, bones[joints.astype(np.int64)])
    return np.einsum("vrc,vc->vr", blend[:, :3, :3], primitive.points) + blend[:, :3, 3], False


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
        if weight and isinstance(target, dict) and "POSITION" in target:
            moved = array(document, target["POSITION"])
            if moved.shape != primitive.points.shape:
                raise GltfError("a morph target has another number of points")
            primitive.points += float(weight) * moved
