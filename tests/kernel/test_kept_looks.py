"""What materials from files say of pixels waits in memory between kernels: nothing of an earlier
picture, or of another face, may be read for it."""

import numpy as np
import pytest
from golden.looks_scene import write_yard
from pictures import camera_in, flat

from twin.render.trace import bvh
from twin.render.trace.cutouts import mark_holes
from twin.world.scene import load_scene
from twin.world.street.build import build_world

BEFORE, AFTER = (0.0, 0.0, 0.0), (2.0, 0.5, 0.25)


@pytest.fixture(scope="module")
def yard(tmp_path_factory):
    return build_world(load_scene(str(write_yard(tmp_path_factory.mktemp("yard")))))


@pytest.mark.parametrize("reflections", [False, True])
@pytest.mark.parametrize("way", ["drawn", "traced"])
def test_a_picture_has_nothing_of_the_one_before(yard, way, reflections, monkeypatch):
    """The sign, the mirror and the bumps are elsewhere in the second picture."""
    if way == "traced":
        monkeypatch.setattr("twin.render.camera.raster_of", lambda *_: None)
    spec = {"mount": (0.0, 0.0, 1.2), "size": (160, 90), "reflections": reflections}
    used, fresh = camera_in(yard, **spec), camera_in(yard, **spec)
    before = used.render(flat(BEFORE)).copy()
    after = used.render(flat(AFTER)).copy()
    assert (np.abs(before.astype(int) - after).max(axis=-1) > 20).mean() > 0.2
    np.testing.assert_array_equal(after, fresh.render(flat(AFTER)))


def test_leaves_of_several_meshes_are_marked_where_their_faces_have_holes():
    rng = np.random.default_rng(5)
    counts, leaves = (7, 12, 1), []
    for count in counts:
        points = rng.normal(size=(3 * count, 3))
        faces = np.arange(3 * count).reshape(-1, 3)
        leaves.append(bvh.build_bvh(points, faces, bvh.CUDA).leaves)
    of_face = np.where(rng.random(sum(counts)) < 0.4, rng.integers(0, 3, sum(counts)), -1)
    first_face = np.cumsum([0, *counts])
    words = np.concatenate([part.ravel() for part in leaves])
    kept = words.copy()
    rows = mark_holes(words, of_face, first_face).reshape(-1, 3, 4)
    np.testing.assert_array_equal(words, kept)  # they may be shared with other rigs
    for part, first in enumerate(first_face[:-1]):
        own = rows[first : first + counts[part]].view(np.int32)
        holes = of_face[first + own[:, 0, 3]] >= 0
        np.testing.assert_array_equal(own[:, 1, 3] != 0, holes)
        np.testing.assert_array_equal(own[:, 0, 3], leaves[part].view(np.int32)[:, 0, 3])
    assert 0 < (of_face >= 0).sum() < len(of_face)
    np.testing.assert_array_equal(rows[:, :, :3], np.concatenate(leaves)[:, :, :3])
