"""Faces that are drawn and rays that are traced give the same bytes."""

import numpy as np
import pytest
from pictures import Script, box_mesh, camera_in, flat, light_slot, mesh_of, states, world_of

from schemas.sections.lens import CameraMount, Lens
from twin.actors.motion import ObjectKind
from twin.world.scene import load_scene
from twin.world.street.build import build_world

LENSES = {
    "pinhole": Lens(near_m=0.2),
    "shifted": Lens(fx=0.9, fy=1.4, cx=0.4, cy=0.6),
    "frustum": Lens(
        model="frustum", near_m=0.5, left_m=-0.3, right_m=0.5, top_m=0.2, bottom_m=-0.25
    ),
}


@pytest.fixture(scope="module")
def district():
    return build_world(load_scene("downtown"))


def pair(world, monkeypatch, **spec):
    """Two cameras, one that draws and one that traces."""
    drawn = camera_in(world, **spec)
    assert drawn._raster is not None
    with monkeypatch.context() as patched:
        patched.setattr("twin.render.camera.raster_of", lambda *_: None)
        traced = camera_in(world, **spec)
    assert traced._raster is None
    return drawn, traced


def alike(drawn, traced):
    """The outputs of both agree to the last bit; returns the share of pixels that see something."""
    a, b = drawn.outputs, traced.outputs
    for name in a:
        np.testing.assert_array_equal(a[name], b[name])
    return np.isfinite(a["depth"]).mean()


@pytest.mark.parametrize("name", LENSES)
def test_the_district(name, district, monkeypatch):
    mount = CameraMount(
        position_m=[1.5, 0.0, 1.4], rotation_deg=[2.0, 5.0, -20.0], lens=LENSES[name]
    )
    spec = {"mount": mount, "size": (161, 93), "outputs": ["depth", "instance", "normal"]}
    drawn, traced = pair(district, monkeypatch, slots=3, **spec)
    poses = flat((60.0, 0.0, 0.1), (110.0, 1.0, -0.3), (130.0, 3.0, 2.8))
    pictures = []
    for camera in (drawn, traced):
        for slot, (weather, minute) in enumerate(
            [("clear", 660), ("heavy_rain", 1300), ("cloudy", 900)]
        ):
            light_slot(camera, slot, weather, minute)
        camera.geometry.place(district.motion.at(np.array([0.0, 3.0, 9.0])))
        pictures.append(camera.render(poses).astype(int))
    assert alike(drawn, traced) > 0.5
    np.testing.assert_array_equal(*pictures)


@pytest.mark.parametrize("seed", range(3))
def test_faces_around_and_behind_the_camera(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    count = 600
    middle = rng.normal(size=(count, 1, 3)) * 8.0
    size = 10.0 ** rng.uniform(-1.0, 1.5, (count, 1, 1))  # up to some that surround the camera
    points = (middle + rng.normal(size=(count, 3, 3)) * size).reshape(-1, 3)
    mesh = mesh_of(points, np.arange(3 * count).reshape(-1, 3))
    kind = ObjectKind("box", box_mesh((1.0, 0.5, 0.7)), 1.0, 0.5)
    script = Script(position_m=rng.normal(size=(9, 3)) * 4.0, yaw_rad=rng.uniform(-3, 3, 9))
    world = world_of(mesh, kinds=(kind,), motion=script, mover_classes=(0,) * 9)
    spec = {
        "size": (120, 70),
        "outputs": ["depth", "instance", "normal"],
        "mount": CameraMount(position_m=[0.0, 0.0, 0.0], lens=Lens(near_m=0.01)),
    }
    drawn, traced = pair(world, monkeypatch, **spec)
    turn = rng.normal(size=4)
    turn /= np.linalg.norm(turn)
    for camera in (drawn, traced):
        camera.geometry.place(script.at(np.zeros(1)))
        camera.render(states([rng.normal(size=3) * 0.0], [turn]))
    assert alike(drawn, traced) > 0.5


def test_lenses_that_distort_are_traced(district):
    mount = CameraMount(position_m=[0.0, 0.0, 1.4], lens=Lens(model="fisheye"))
    assert camera_in(district, mount=mount)._raster is None
