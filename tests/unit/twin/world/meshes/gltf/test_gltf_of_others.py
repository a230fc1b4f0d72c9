"""Files of other projects, beside an independent reader of glTF: trimesh.

What trimesh reads wrong (sparse accessors, fans, normalized positions) stands here in numbers.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh

from twin.world.meshes.mesh_file import load_mesh

FILES = Path(__file__).parents[7] / "shared" / "data" / "gltf"
pytestmark = pytest.mark.skipif(not FILES.is_dir(), reason=f"{FILES} is not there")

REFUSED = {
    "box-shared-image-references.gltf": "it requires the extension KHR_techniques_webgl",
    "box-shared-image-references-separate.gltf": "it requires the extension KHR_techniques_webgl",
    "box-techniques-embedded.gltf": "it requires the extension KHR_techniques_webgl",
    "box-techniques-separate.gltf": "it requires the extension KHR_techniques_webgl",
    "mixed_draco.gltf": "Draco",  # its data are no Draco data
    "integer-out-of-bounds.gltf": "'byteLength' is 1e+300, needed a whole number",
    "invalid-buffer-index.gltf": "the mesh has no faces",
    "invalid-buffer-view-index.gltf": "the mesh has no faces",
    "invalid-primitive-indices.gltf": "its JSON is no glTF document",
}
LARGE = ("AlphaBlendModeTest", "CesiumMilkTruck")
COPY = {"meshopt-no-fallback.gltf": "meshopt-fallback/meshopt-fallback.gltf"}
"""The same uncompressed, of files that trimesh cannot read."""
KNOWN = {
    "SimpleSparseAccessor.gltf": (12, [0, 0, 0], [6, 4, 0]),
    "mixed_fan.gltf": (4, [0, 0, 0], [3, 1, 0]),
    "quantized_norm.gltf": (2, [0, 0, 0], [2, 2, 0]),
}
"""Faces and bounds of files that trimesh reads otherwise."""


def files():
    return sorted(path for path in FILES.rglob("*.gl*") if path.suffix in (".gltf", ".glb"))


def in_lanes(paths):
    """Paths as parameters; files with large pictures are for the full lane."""
    return [
        pytest.param(path, marks=pytest.mark.slow) if path.stem in LARGE else path for path in paths
    ]


def test_there_are_enough():
    assert len(files()) >= 40
    assert {path.name for path in files()} >= {*REFUSED, *KNOWN}


@pytest.mark.parametrize("path", in_lanes(files()), ids=lambda path: path.stem)
def test_a_file_comes_in_as_an_independent_reader_has_it(path):
    if path.name in REFUSED:
        with pytest.raises(ValueError) as error:
            load_mesh(path)
        assert REFUSED[path.name] in str(error.value)
        assert "\n" not in str(error.value)
        return
    if path.name in COPY:
        pytest.importorskip("meshopt", reason="meshopt is not installed")
    parts = load_mesh(path).parts
    corners = np.concatenate([part.points[part.faces] for part in parts])
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    if path.name in KNOWN:
        faces, lowest, highest = KNOWN[path.name]
        assert len(corners) == faces
        np.testing.assert_allclose([low, high], [lowest, highest], atol=1e-6)
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        copy = path.parents[1] / COPY[path.name] if path.name in COPY else path
        scene = trimesh.load_scene(copy, process=False, validate=False)
    theirs = [each for each in scene.dump(concatenate=False) if hasattr(each, "faces")]
    expected = np.concatenate([each.vertices[each.faces] for each in theirs])
    assert len(corners) == len(expected)
    np.testing.assert_allclose(ordered(corners), ordered(expected), atol=1e-5)
    assert volume(corners) == pytest.approx(volume(expected), rel=1e-4, abs=1e-6)
    assert sum(part.image is not None for part in parts) <= len(parts)


def ordered(corners):
    """Triangles in an order of their own, each turned to begin with its lowest corner."""
    rows = []
    for triangle in np.round(corners, 4).tolist():
        first = triangle.index(min(triangle))
        rows.append(triangle[first:] + triangle[:first])
    return np.array(sorted(rows))


def volume(corners):
    """Signed volume between the triangles and the origin."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    return float((a * np.cross(b, c)).sum() / 6.0)


@pytest.mark.slow
def test_base_colours_of_the_truck():
    parts = load_mesh(FILES / "trimesh" / "CesiumMilkTruck.glb").parts
    pictures = [part.image for part in parts if part.image is not None]
    assert len(pictures) == 3
    assert len({id(picture) for picture in pictures}) == 1, "body and wheels share their picture"
    plain = sorted(part.color[0].tolist() for part in parts if part.image is None)
    np.testing.assert_allclose(plain, [[0, 0.0405, 0.0213], [0.0640, 0.0640, 0.0640]], atol=5e-4)
