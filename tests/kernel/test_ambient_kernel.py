"""Baked ambient light against closed forms."""

import math

import numpy as np
import pytest

from twin.world.meshes import materials
from twin.world.meshes.mesh import MeshBuilder
from twin.world.scene import load_scene
from twin.world.street import ambient
from twin.world.street.ambient import bake, baked, directions
from twin.world.street.build import build_world

GREY = (0.3, 0.3, 0.3)


def floor(mesh, half=60.0):
    mesh.floor((-half, half), (-half, half), 0.0, materials.PLAIN, GREY, pitch_m=2.0)


def value_at(mesh, x, y, z=0.0):
    """The baked value of the vertex nearest to a point."""
    built = mesh.build()
    i = np.linalg.norm(built.points_m - (x, y, z), axis=1).argmin()
    assert np.linalg.norm(built.points_m[i] - (x, y, z)) < 1e-3
    return bake(built)[i] / 255.0


def test_directions_have_the_density_of_a_cosine():
    rays = directions()
    assert len(rays) >= 48
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0, atol=1e-6)
    # Means over cos / pi: E[z] = 2/3, E[x] = E[y] = 0, E[x^2] = 1/4.
    np.testing.assert_allclose(rays.mean(axis=0), [0, 0, 2 / 3], atol=0.01)
    np.testing.assert_allclose((rays**2).mean(axis=0), [0.25, 0.25, 0.5], atol=0.01)


def test_open_ground_and_a_lone_wall_see_the_whole_sky():
    mesh = MeshBuilder()
    floor(mesh)
    mesh.quad([(-1, 0, 0), (1, 0, 0), (1, 0, 2), (-1, 0, 2)], materials.PLAIN, GREY)
    assert value_at(mesh, 20.0, -20.0) == 1.0
    assert value_at(mesh, 1.0, 0.0, 2.0) == 1.0


def test_beside_a_long_high_wall_half_the_sky_is_left():
    mesh = MeshBuilder()
    floor(mesh)
    mesh.quad([(-60, 0.1, 0), (60, 0.1, 0), (60, 0.1, 60), (-60, 0.1, 60)], materials.PLAIN, GREY)
    assert value_at(mesh, 0.0, 0.0) == pytest.approx(0.5, abs=0.02)


def test_in_a_trench():
    """On the middle of a trench of half width w and depth h: sin(atan(w / h)) is left."""
    w, h = 3.0, 4.0
    mesh = MeshBuilder()
    mesh.floor((-20, 20), (-w, w), 0.0, materials.PLAIN, GREY, pitch_m=w)
    for y in (-w, w):
        mesh.quad([(-20, y, 0), (20, y, 0), (20, y, h), (-20, y, h)], materials.PLAIN, GREY)
    expected = math.sin(math.atan(w / h))
    assert value_at(mesh, 0.0, 0.0) == pytest.approx(expected, abs=0.04)


def test_under_a_roof_nothing_is_left_and_leaves_stay_green():
    for material, expected in ((materials.PLAIN, 0.0), (materials.FOLIAGE, ambient.LEAF_SHARE)):
        mesh = MeshBuilder()
        mesh.floor((-2, 2), (-2, 2), 0.0, material, GREY, pitch_m=2.0)
        mesh.box((-9, -9, -1), (9, 9, 4), materials.PLAIN, GREY)
        assert value_at(mesh, 0.0, 0.0) == pytest.approx(expected, abs=1 / 255)


def test_a_body_turned_inside_out_is_lit_from_outside():
    values = []
    for order in (1, -1):
        mesh = MeshBuilder()
        floor(mesh)
        body = MeshBuilder()
        body.box((-1, -1, 3), (1, 1, 5), materials.PLAIN, GREY)
        built = body.build()
        mesh.add(built.points_m, built.faces[:, ::order], materials.PLAIN, GREY)
        whole = bake(mesh.build())
        values.append(whole[-len(built.points_m) :].mean() / 255)
    assert values[0] == values[1] > 0.9


def test_the_cache_gives_the_same_and_may_be_unwritable(tmp_path, monkeypatch):
    mesh = MeshBuilder()
    floor(mesh, 8.0)
    mesh.box((-1, -1, 0), (1, 1, 3), materials.PLAIN, GREY)
    built = mesh.build()
    monkeypatch.setattr(ambient, "kept_folder", lambda name: tmp_path / name)
    first = baked([built])[0].ambient
    (stored,) = (tmp_path / "ambient").iterdir()
    assert stored.stat().st_size == len(built.points_m)
    stored.write_bytes(bytes(len(built.points_m)))  # it is read, not worked out again
    assert baked([built])[0].ambient.max() == 0.0
    stored.write_bytes(b"torn")  # and ignored where it cannot be right
    assert baked([built])[0].ambient.tobytes() == first.tobytes()
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setattr(ambient, "kept_folder", lambda name: tmp_path / "file" / name)
    assert baked([built])[0].ambient.tobytes() == first.tobytes()


def test_shipped_scene_is_baked_in_steps_of_a_255th():
    mesh = build_world(load_scene("downtown")).mesh
    steps = mesh.ambient * 255
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-4)
    cars = mesh.faces[mesh.instance == 0]
    assert mesh.ambient[cars].max() > 0.4
    assert mesh.ambient[cars].mean() > 0.15
    assert 0.05 < (mesh.ambient < 0.2).mean() < 0.6
