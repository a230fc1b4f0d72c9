"""The standing world for viewers: one mesh with colours, packed once per rig."""

from __future__ import annotations

import hashlib
import zlib

import numpy as np

from schemas import SCHEMA_VERSION
from schemas.wire.view import SceneMesh
from twin.world.meshes.mesh import Mesh
from twin.world.meshes.srgb import linear, srgb
from twin.world.street.build import World

_SUN = np.array([0.35, 0.45, 0.82], np.float32)
"""Towards a sun for the eye alone: viewers know no light, and faces must differ to be seen."""

_SHADE = 0.45
"""Brightness of a face that looks away from it [-]."""

_LEVEL = 3
"""Level of compression: 70,000 triangles become about 1 MB in 0.1 s."""


def pack_scene(world: World) -> SceneMesh:
    """Positions, faces and colours of the world's standing mesh."""
    mesh = world.mesh
    colors = _colors(mesh, world.textures)
    # Rerun colours vertices, the simulator faces: a vertex appears once per colour.
    _, shade = np.unique(colors.astype(np.uint32) @ (1 << 16, 1 << 8, 1), return_inverse=True)
    corners = mesh.faces.astype(np.int64) * (int(shade.max(initial=0)) + 1) + shade[:, None]
    _, first, faces = np.unique(corners, return_index=True, return_inverse=True)
    points = mesh.points_m[mesh.faces.reshape(-1)[first]]
    data = b"".join(
        (
            points.astype("<f4").tobytes(),
            faces.astype("<u4").tobytes(),
            colors[first // 3].tobytes(),
        )
    )
    return SceneMesh(
        v=SCHEMA_VERSION,
        sha256=hashlib.sha256(data).hexdigest(),
        vertices=len(points),
        faces=len(mesh.faces),
        data=zlib.compress(data, _LEVEL),
    )


def _colors(mesh: Mesh, textures: tuple[np.ndarray, ...]) -> np.ndarray:
    """sRGB of every face, uint8 [F, 3]: its colour or its image's mean, shaded."""
    reflectance = mesh.color.astype(np.float32)
    for index, image in enumerate(textures):
        mean = linear(image.reshape(-1, 3) / 255.0).mean(axis=0)
        reflectance = np.where((mesh.texture == index)[:, None], mean, reflectance)
    a, b, c = (mesh.points_m[mesh.faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    light = _SHADE + (1 - _SHADE) * np.clip(normal @ _SUN, 0.0, 1.0)
    light *= mesh.ambient[mesh.faces].mean(axis=1)
    return np.rint(255 * srgb(reflectance * light[:, None])).astype(np.uint8)
