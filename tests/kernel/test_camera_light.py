"""Lamps of vehicles, mirrors and glass."""

from dataclasses import replace

import numpy as np
import pytest
from pictures import Script, box_mesh, camera_in, flat, joined, light_slot, mesh_of, quad, world_of

from schemas.messages import Lights
from twin.actors.motion import ObjectKind
from twin.render import camera as camera_module
from twin.render.build import CPU, KernelOptions
from twin.world.meshes import materials

ROAD = quad((-50, -300, -1.4), (600, -300, -1.4), (600, 300, -1.4), (-50, 300, -1.4))
NIGHT = {"weather": "clear", "minute": 0, "lights": Lights()}


def materials_of(*groups):
    """Material column for groups of (number of faces, material)."""
    return np.concatenate([np.full(n, m, np.int32) for n, m in groups])


def car_ahead(lamps, brake, yaw, x=14.0):
    """A box whose rear or front, two metres up, is a lamp."""
    shell = box_mesh((2.0, 0.9, 0.7))
    faces = shell.points_m[shell.faces]
    rear = (faces[:, :, 0] < -1.9).all(axis=1)
    front = (faces[:, :, 0] > 1.9).all(axis=1)
    material = np.where(rear, materials.TAIL_LAMP, np.where(front, materials.HEAD_LAMP, 0))
    mesh = mesh_of(shell.points_m, shell.faces, material=material.astype(np.int32))
    kind = ObjectKind("car", mesh, 2.0, 0.9)
    script = Script(
        position_m=np.array([[x, 0.0, -1.4]]),
        yaw_rad=np.array([yaw]),
        lamps=np.array([lamps], np.float32),
        brake=np.array([brake], np.float32),
    )
    road = mesh_of(*ROAD, material=np.full(2, materials.ASPHALT, np.int32))
    return world_of(road, kinds=(kind,), motion=script, mover_classes=(0,))


def shoot(world, **light):
    camera = camera_in(world, size=(128, 72), outputs=["instance"])
    light_slot(camera, 0, **{**NIGHT, **light})
    camera.geometry.place(world.motion.at(np.zeros(1)))
    picture = camera.render(flat((0, 0, 0)))[0].astype(float)
    return picture, camera.outputs["instance"][0]


def test_brake_lamps_shine_red_and_on_the_road_behind():
    off, on_car = shoot(car_ahead(0.0, 0.0, 0.0))
    tail, _ = shoot(car_ahead(1.0, 0.0, 0.0))
    brake, _ = shoot(car_ahead(1.0, 1.0, 0.0))
    lamp = on_car == 0
    assert lamp.sum() > 20
    red = [picture[lamp][:, 0].mean() for picture in (off, tail, brake)]
    assert red[0] + 30 < red[1] <= red[2]
    assert (brake[lamp].argmax(axis=1) == 0).mean() > 0.9
    behind = np.s_[44:50, 60:68]  # road between camera and car
    assert not lamp[behind].any()
    gain = (brake - off)[behind].reshape(-1, 3).mean(axis=0)
    assert gain[0] > 2.0
    assert gain[0] > 3.0 * gain[2]


def test_headlamps_light_the_road_before_them_and_glow_in_fog():
    off, _ = shoot(car_ahead(0.0, 0.0, np.pi, x=30.0))
    on, on_car = shoot(car_ahead(1.0, 0.0, np.pi, x=30.0))
    assert on[on_car == 0].max() > 200
    near = np.s_[40:44, 60:68]  # ten to twenty metres before the oncoming car
    assert (on - off)[near].mean() > 3.0
    above = np.s_[26:33, 58:70]
    assert (on_car[above] == -1).all()
    fog_off, _ = shoot(car_ahead(0.0, 0.0, np.pi, x=30.0), weather="heavy_fog")
    fog_on, _ = shoot(car_ahead(1.0, 0.0, np.pi, x=30.0), weather="heavy_fog")
    assert (fog_on - fog_off)[above].mean() > (on - off)[above].mean() + 0.5


def test_lamps_of_others_are_off_by_day():
    noon = {"weather": "clear", "minute": 720}
    a, _ = shoot(car_ahead(0.0, 0.0, 0.0), **noon)
    b, _ = shoot(car_ahead(1.0, 0.0, 0.0), **noon)
    assert (a == b).all()


@pytest.mark.parametrize("weather", ["clear", "heavy_rain"])
def test_wet_road_mirrors_what_stands_on_it(weather):
    wall = quad((30, -20, -1.4), (30, 20, -1.4), (30, 20, 9), (30, -20, 9))
    points, faces = joined(ROAD, wall)
    material = materials_of((2, materials.ASPHALT), (2, materials.PLAIN))
    pictures = []
    for color in ((0.9, 0.05, 0.05), (0.05, 0.05, 0.9)):
        columns = np.full((4, 3), 0.09, np.float32)
        columns[2:] = color
        world = world_of(mesh_of(points, faces, material=material, color=columns))
        camera = camera_in(world, size=(128, 72))
        light_slot(camera, 0, weather, 900, rain=0.0)
        pictures.append(camera.render(flat((0, 0, 0)))[0].astype(float))
    road = np.s_[41:46, 30:98]  # 10 to 18 m away
    change = (pictures[0] - pictures[1])[road].reshape(-1, 3).mean(axis=0)
    if weather == "clear":
        assert np.abs(change).max() < 0.5
    else:
        assert change[0] > 1.0
        assert change[2] < -1.0


def test_glass_shows_what_is_behind_it_and_shells_are_dark():
    pane = quad((8, -3, -1), (8, 3, -1), (8, 3, 1), (8, -3, 1))
    wall = quad((20, -30, -1.4), (20, 30, -1.4), (20, 30, 9), (20, -30, 9))
    shell = quad((8.02, -3, -1), (8.02, 3, -1), (8.02, 3, 1), (8.02, -3, 1))
    pictures = {}
    for name, parts in {
        "none": (ROAD, wall),
        "glass": (ROAD, wall, pane),
        "shell": (ROAD, wall, pane, shell),
    }.items():
        points, faces = joined(*parts)
        material = np.zeros(len(faces), np.int32)
        material[4:6] = materials.GLASS
        color = np.full((len(faces), 3), 0.03, np.float32)
        color[2:4] = (0.8, 0.5, 0.2)
        camera = camera_in(
            world_of(mesh_of(points, faces, material=material, color=color)), size=(64, 36)
        )
        light_slot(camera, 0, "cloudy", 720)
        pictures[name] = camera.render(flat((0, 0, 0)))[0].astype(float)[14:20, 26:38]
    means = {name: p.reshape(-1, 3).mean(axis=0) for name, p in pictures.items()}
    assert means["glass"][0] < means["none"][0]
    assert means["glass"][0] > 0.6 * means["none"][0]
    assert means["glass"][0] > means["glass"][2] + 15  # the wall's colour
    assert means["shell"][0] < 0.75 * means["glass"][0]


def test_pictures_in_tiles_are_those_of_a_thread_per_pixel(monkeypatch):
    """What a CPU does in another order than a GPU: noise and tone of a tile at once, and bodies
    right behind panes before all else. The body leans: it is 2 to 18 cm behind the pane."""
    pane = quad((8, -3, -1), (8, 3, -1), (8, 3, 1), (8, -3, 1))
    wall = quad((20, -30, -1.4), (20, 30, -1.4), (20, 30, 9), (20, -30, 9))
    body = quad((8.02, -3, -1), (8.18, 3, -1), (8.18, 3, 1), (8.02, -3, 1))
    points, faces = joined(ROAD, wall, pane, body)
    color = np.full((len(faces), 3), 0.03, np.float32)
    color[2:4], color[6:] = (0.8, 0.5, 0.2), (0.1, 0.2, 0.9)
    material = materials_of((4, materials.PLAIN), (2, materials.GLASS), (2, materials.PLAIN))
    world = world_of(mesh_of(points, faces, material=material, color=color))
    pixels = replace(CPU, mirror=KernelOptions(block=1), picture=KernelOptions(block=1))
    pictures = []
    for tuning in (CPU, pixels):
        monkeypatch.setattr(camera_module, "tuning_for", lambda _device, tuning=tuning: tuning)
        camera = camera_in(world, size=(139, 77), noise=True)
        light_slot(camera, 0, "cloudy", 720, noise=1, tick=3)
        pictures.append(camera.render(flat((0, 0, 0)))[0].copy())
    np.testing.assert_array_equal(*pictures)
    row = pictures[0][36:41, 45:95].astype(float).mean(axis=0)
    assert row[-5:].max() < 0.7 * row[:5, 2].min(), "dark right of where the body is too far away"


def test_baked_ambient_darkens_the_light_of_the_sky():
    points, faces = ROAD
    pictures = []
    for share in (1.0, 0.3):
        world = world_of(mesh_of(points, faces, ambient=np.full(4, share, np.float32)))
        camera = camera_in(world, size=(64, 36))
        light_slot(camera, 0, "cloudy", 720)
        pictures.append(camera.render(flat((0, 0, 0)))[0].astype(float)[28:].mean())
    assert pictures[1] < 0.8 * pictures[0]


def test_second_rays_are_an_option():
    points, faces = joined(ROAD, quad((8, -3, -1), (8, 3, -1), (8, 3, 1), (8, -3, 1)))
    material = materials_of((2, materials.ASPHALT), (2, materials.GLASS))
    world = world_of(mesh_of(points, faces, material=material))
    pictures = {}
    for reflections in (True, False):
        camera = camera_in(world, reflections=reflections)
        light_slot(camera, 0, "heavy_rain", 720)
        pictures[reflections] = camera.render(flat((0, 0, 0)))[0].astype(float)
        listed = int(camera._seen.listed_count.numpy()[0])
        assert (listed > 0) == reflections
        assert camera.rays_per_frame() >= 64 * 36 + listed
    assert np.abs(pictures[True] - pictures[False])[12:24, 20:44].mean() > 2.0
    upper = np.s_[:8]  # the sky is the same
    assert (pictures[True][upper] == pictures[False][upper]).all()
