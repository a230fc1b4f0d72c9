"""Base colours of other projects' files, beside trimesh's materials and pictures that PIL reads.

The mean over the surface, in linear light: so a picture must lie where its coordinates say.
"""

from __future__ import annotations

import warnings
from functools import cache

import numpy as np
import pytest
import trimesh
from PIL import Image
from unit.twin.world.meshes.gltf.test_gltf_of_others import (
    COPY,
    FILES,
    LARGE,
    REFUSED,
    files,
    in_lanes,  # pytest.mark.slow for large ones, by which the rest lane finds this file
)

from twin.world.meshes.mesh_file import load_mesh

pytestmark = pytest.mark.skipif(not FILES.is_dir(), reason=f"{FILES} is not there")
GREY = 0.35
"""Of what has no material."""
NEAR = 2 / 255
"""Linear; trimesh holds factors as bytes."""
PICTURES = {
    "2.0/box-textured-separate/box-textured-separate.gltf": "cesium logo.png",
    "EXT_texture_webp/box-textured-separate/box-textured-separate.gltf": "cesium logo.webp",
    "EXT_texture_webp/box-textured-separate/box-textured-with-fallback.gltf": "cesium logo.webp",
    "models/CubeImageUriSpaces/CubeImageUriMultipleSpaces.gltf": (
        " 2x2 image  has multiple      spaces.png"
    ),
}
"""Pictures whose names have spaces, which trimesh does not find, by the end of the file's path."""


def colored():
    """Files that come in."""
    return [path for path in files() if path.name not in REFUSED]


def linear(values):
    """Linear light of sRGB from 0 to 1 (IEC 61966-2-1)."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def sampled(picture, uv):
    """Linear colours [..., 3] of a picture [h, w, 3] at u to the right and v up; it repeats."""
    height, width = picture.shape[:2]
    columns = np.floor(uv[..., 0] % 1.0 * width).astype(int) % width
    rows = np.floor((1.0 - uv[..., 1]) % 1.0 * height).astype(int) % height
    return linear(picture[rows, columns] / 255.0)


def over_faces(values):
    """Means of what three corners have [F, 3, n], at points spread over each face [F, P, n]."""
    steps = (np.arange(6) + 0.5) / 6
    weights = [(a, b, 1 - a - b) for a in steps for b in steps if a + b < 1]
    return np.einsum("pc,fcn->fpn", np.array(weights), values)


def mean_color(pieces):
    """Area-weighted mean of (corners [F, 3, 3], linear colours [F, 3])."""
    area = [
        np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1) for c, _ in pieces
    ]
    total = sum(
        (a[:, None] * color).sum(axis=0) for a, (_, color) in zip(area, pieces, strict=True)
    )
    return total / sum(a.sum() for a in area)


@cache
def ours(path):
    pieces = []
    for part in load_mesh(path).parts:
        color = part.color
        if part.image is not None:
            color = sampled(part.image, over_faces(part.uv[part.faces])).mean(axis=1)
        pieces.append((part.points[part.faces], color))
    return mean_color(pieces)


def theirs(path, picture):
    """``picture``: instead of those that trimesh has found."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene = trimesh.load_scene(path, process=False, validate=False)
    pieces = []
    for mesh in scene.dump(concatenate=False):
        if hasattr(mesh, "faces"):
            faces = np.asarray(mesh.faces)
            pieces.append(
                (np.asarray(mesh.vertices)[faces], their_color(mesh.visual, faces, picture))
            )
    return mean_color(pieces)


def their_color(visual, faces, picture):
    """Linear colours of faces [F, 3]."""
    if visual.kind == "vertex":
        return (visual.vertex_colors[faces][..., :3] / 255.0).mean(axis=1)
    if visual.kind is None:
        return np.full((len(faces), 3), GREY)
    factor = visual.material.baseColorFactor
    factor = np.ones(3) if factor is None else np.asarray(factor)[:3] / 255.0
    found = visual.material.baseColorTexture
    if picture is None and found is not None:
        picture = np.asarray(found.convert("RGB"))
    if picture is None:
        return np.broadcast_to(factor, (len(faces), 3))
    uv = over_faces(np.asarray(visual.uv)[faces])
    return sampled(picture, uv).mean(axis=1) * factor


def test_most_files_have_colours_of_their_own():
    plain = [path for path in colored() if path.name not in COPY and path.stem not in LARGE]
    own = [path for path in plain if not np.allclose(ours(path), GREY)]
    assert len(own) >= 25


@pytest.mark.parametrize("path", in_lanes(colored()), ids=lambda path: path.stem)
def test_base_colours_are_those_of_an_independent_reader(path):
    picture = None
    if name := PICTURES.get("/".join(path.parts[-3:])):
        picture = np.asarray(Image.open(path.parent / name).convert("RGB"))
    if path.name in COPY:
        pytest.importorskip("meshopt", reason="meshopt is not installed")
    other = path.parents[1] / COPY[path.name] if path.name in COPY else path
    np.testing.assert_allclose(ours(path), theirs(other, picture), atol=NEAR)
