"""Pieces of a glTF file -> parts of a mesh, with their pictures made ready."""

from __future__ import annotations

import numpy as np

from twin.world.meshes.gltf.reader import GltfPiece
from twin.world.meshes.part import CUTOFF_MAX, Part
from twin.world.meshes.part_images import PartImages
from twin.world.meshes.srgb import linear


def gltf_part(piece: GltfPiece, images: PartImages) -> Part:
    """A part with the look of ``piece``; its faces are not yet checked against its points.

    Raises:
        ValueError: a picture cannot be read; one line.
    """
    look = piece.look
    part = Part(piece.points, piece.faces, np.zeros((len(piece.faces), 3)), piece.uv)
    part.normals, part.tangents = piece.normals, piece.tangents
    part.emission = list(look.emission)
    part.metallic, part.roughness = (min(max(v, 0.0), 1.0) for v in (look.metallic, look.roughness))
    part.normal_scale = look.normal_scale
    part.color[:] = piece.factor
    if piece.picture is not None:
        assert look.base is not None
        part.image = images.color(piece.picture, piece.factor)
        part.wrap = list(look.base.wrap)
        part.color[:] = linear(part.image.reshape(-1, 3) / 255.0).mean(axis=0)
        if look.cutoff > 0.0:
            part.alpha = images.alpha(piece.picture)
            part.cutoff = min(255.0 * look.cutoff / max(look.alpha, 1e-6), CUTOFF_MAX)
    if piece.colors is not None and _named_are_there(piece.faces, len(piece.points)):
        part.color *= piece.colors[piece.faces].mean(axis=1)
        part.colors = piece.colors if part.image is not None else piece.colors * piece.factor
    for place, picture in enumerate(piece.maps):
        found = look.maps[place]
        if picture is not None and found is not None:
            part.maps[place] = images.map(picture)
            part.map_wraps[place] = list(found.wrap)
    part.map_from_uv = piece.map_from_uv
    return part


def _named_are_there(faces: np.ndarray, count: int) -> bool:
    return not len(faces) or bool(faces.min() >= 0 and faces.max() < count)
