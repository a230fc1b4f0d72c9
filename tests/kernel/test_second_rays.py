"""Second rays that are traced by one kernel and shaded by others, as on a GPU, have the bytes of
those of the kernel that does both."""

from dataclasses import replace

import numpy as np
import pytest
from golden.looks_scene import quad, write_yard
from pictures import camera_in, flat, light_slot
from unit.twin.world.meshes.gltf.gltf_files import GltfFile

from twin.render.build import CPU, KernelOptions, Tuning
from twin.world.scene import load_scene
from twin.world.street.build import build_world

ALONE = KernelOptions(block=1)
APART = replace(CPU, hits=ALONE, light=ALONE, light_detailed=ALONE)
LIGHTS = [("clear", 720), ("clear", 1140), ("heavy_rain", 600), ("heavy_rain", 1380)]
"""Sun, low sun, and wet ground by day and by night; the last slots of a picture."""


@pytest.fixture(scope="module", params=["yard", "street"])
def world(request, tmp_path_factory):
    """A yard of materials from files with a pane that one looks through, and a plain street."""
    if request.param == "street":
        return build_world(load_scene("downtown"))
    folder = tmp_path_factory.mktemp("panes")
    scene = write_yard(folder)
    pane = GltfFile()
    quad(pane, (5, 2, 0.4), (5, -1, 0.4), (0, 0, 1.6))
    pane.write(folder / "pane.glb")
    with scene.open("a") as file:
        file.write("  - {file: pane.glb, up: z, semantic: wall, material: glass}\n")
    return build_world(load_scene(str(scene)))


def rendered(world, tuning: Tuning, monkeypatch, **spec):
    """Pictures of all lights, and their camera."""
    monkeypatch.setattr("twin.render.camera.tuning_for", lambda _: tuning)
    camera = camera_in(world, len(LIGHTS), mount=(0.0, 0.0, 1.2), size=(160, 90), **spec)
    for slot, (weather, minute) in enumerate(LIGHTS):
        light_slot(camera, slot, weather, minute)
    return camera.render(flat(*[(0.0, 0.0, 0.1)] * len(LIGHTS))).copy(), camera


def test_rays_traced_and_shaded_apart_have_the_bytes_of_one_kernel(world, monkeypatch):
    expected, one = rendered(world, CPU, monkeypatch)
    found, apart = rendered(world, APART, monkeypatch)
    np.testing.assert_array_equal(found, expected)
    assert one.second_pixels() == apart.second_pixels() > 1000
    kinds = apart.second_kinds()
    assert one.second_kinds() == {}
    if world.looks:
        assert min(kinds.values()) > 100
        assert sum(kinds.values()) == apart.second_pixels()
    else:
        assert kinds["detailed"] == kinds["plain"] == 0


def test_second_rays_are_seen(world, monkeypatch):
    """What the comparison above is about: without them the pictures are others."""
    mirrors, _ = rendered(world, APART, monkeypatch)
    without, _ = rendered(world, APART, monkeypatch, reflections=False)
    assert (np.abs(mirrors.astype(int) - without).max(axis=-1) > 2).mean() > 0.02


def test_a_second_picture_has_nothing_of_the_first(world, monkeypatch):
    """Lists and hits are used again."""
    _, used = rendered(world, APART, monkeypatch)
    poses = flat(*[(1.5, 0.4, 0.3)] * len(LIGHTS))
    again = used.render(poses).copy()
    expected, one = rendered(world, CPU, monkeypatch)
    assert (again != expected).mean() > 0.2
    np.testing.assert_array_equal(again, one.render(poses))
