"""Light on level ground against pictures of a grey plate, and against another way to say it."""

from dataclasses import replace

import numpy as np
import pytest
from pictures import CPU, flat, light_slot, mesh_of, quad, world_of

from schemas.campaign import Camera
from schemas.messages import Lights
from schemas.sections.lens import CameraMount, Lens
from twin.render.camera import RayCamera
from twin.render.lens import ray_table
from twin.render.light.ground_light import GroundLight
from twin.render.tone import tone_table
from twin.render.trace.geometry import Geometry
from twin.world.scene import Furniture
from twin.world.sky.atmosphere import LUMINANCE

PLATE = quad((-300, -300, 0), (300, -300, 0), (300, 300, 0), (-300, 300, 0))
GREY = 0.4
HEIGHT_M, WIDE, HIGH = 1.4, 64, 36
FURNITURE = Furniture(lamp_height_m=9.0, lamp_intensity_cd=3000.0, lamp_spacing_m=20.0)
LAMPS_M = np.array([(3.0, 3.0), (12.0, -4.0), (20.0, 3.5), (33.0, -2.0), (45.0, 6.0)])
SCATTERED = world_of(mesh_of(*PLATE), lamps=LAMPS_M)
ROWS = replace(world_of(mesh_of(*PLATE)), lamps_right=(4.0, -5.0), lamps_left=(9.0, 6.0))
MIDNIGHT = 0


def signals(world, **light):
    """Linear signal of each pixel of a camera 1.4 m above the plate [H, W, 3]."""
    camera = RayCamera(
        Geometry(world, 1, CPU),
        world,
        FURNITURE,
        Camera(width=WIDE, height=HIGH, hfov_deg=90.0, noise=False),
        CameraMount(position_m=[0.0, 0.0, HEIGHT_M]),
        (1.5, 0.0, 0.7),
    )
    light_slot(camera, 0, "clear", MIDNIGHT, Lights(), **light)
    picture = camera.render(flat((0, 0, 0)))[0]
    table = tone_table()
    index = np.array([np.flatnonzero(table == value).mean() for value in range(256)])
    share = index / (len(table) - 1)
    return (share / (1.0 - share))[picture], float(camera.lights.host[0]["exposure"])


@pytest.mark.parametrize("world", [SCATTERED, ROWS], ids=["scattered", "rows"])
def test_lamps_give_the_light_that_a_grey_plate_shows(world):
    lit, exposure = signals(world, exposure=0.4)
    dark, _ = signals(world, exposure=0.4, lamps_on=0.0)
    shown_lx = ((lit - dark) @ LUMINANCE) / exposure * np.pi / GREY
    rays = ray_table(Lens(), WIDE, HIGH, 90.0).reshape(HIGH, WIDE, 3)
    ground = GroundLight(world, FURNITURE, 1)
    for row, column in ((22, 32), (24, 20), (28, 40), (34, 5), (21, 33), (30, 63)):
        right, down, ahead = rays[row, column].astype(float).tolist()
        place_m = HEIGHT_M * ahead / down, -HEIGHT_M * right / down
        expected = ground.lamps_lx(place_m, 0.0)
        assert expected > 1.0
        assert shown_lx[row, column] == pytest.approx(expected, rel=0.03), place_m
