"""devkit.lane.view: pixels of road places through any mount and lens, and leaning cars."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from camera_sites import camera_site

from devkit.lane.view import PITCH_M, LaneView, left_of, point_of
from devkit.reference.view import CameraView
from schemas.messages import Detection
from schemas.sections.lens import Lens
from schemas.sections.lens_projection import project, vehicle_from_camera

SITES = {
    "ahead": camera_site(),
    "small": camera_site(320, 180),
    "turned": camera_site(rotation_deg=(0.0, 6.0, -8.0)),
    "rolled": camera_site(rotation_deg=(5.0, 2.0, 0.0)),
}


@pytest.mark.parametrize("site", SITES.values(), ids=SITES)
def test_pixels_show_the_places_that_they_stand_for(site):
    view, pinhole = LaneView.of_site(site), CameraView.of_site(site)
    line, point = np.nonzero(view.pixel >= 0)
    assert len(line) > 3000
    for i in range(0, len(line), 97):
        pixel = int(view.pixel[line[i], point[i]])
        x_px, y_px = pixel % site.width, pixel // site.width
        # The place is between the corners of its pixel.
        corners = [(x_px + i, y_px + j) for i in (0, 1) for j in (0, 1)]
        ahead_m = [pinhole.forward_m + pinhole.ground_m(*c) for c in corners]
        assert min(ahead_m) - 1e-9 <= view.ahead_m[line[i]] <= max(ahead_m) + 1e-9
        depth_m = view.ahead_m[line[i]] - pinhole.forward_m
        left_m = [pinhole.across_m(*c, depth_m) for c in corners]
        assert min(left_m) - 1e-9 <= left_of(point[i]) <= max(left_m) + 1e-9


def test_lines_end_where_rows_of_the_image_are_too_far_apart():
    small, large = (LaneView.of_site(SITES[name]) for name in ("small", "ahead"))
    assert small.ahead_m[0] == large.ahead_m[0] == 5.5  # the image's lower edge
    assert large.ahead_m[-1] == 16.0
    tiny = LaneView.of_site(camera_site(64, 36))
    assert tiny.ahead_m[-1] < 10.0


def test_a_camera_that_sees_no_road_ahead_has_an_empty_view():
    view = LaneView.of_site(camera_site(rotation_deg=(0.0, 0.0, 180.0)))
    assert view.ahead_m.shape == (0,)


def test_a_distorting_lens_shifts_pixels_by_its_distortion():
    straight = camera_site()
    bent = msgspec.structs.replace(straight, lens=Lens(model="brown_conrady", k1=-0.2))
    views = [LaneView.of_site(site) for site in (straight, bent)]
    line = int(np.flatnonzero(views[0].ahead_m == 8.0)[0])
    point = int(point_of(np.array(3.0)))
    pixels = [int(view.pixel[list(view.ahead_m).index(8.0), point]) for view in views]
    assert views[0].ahead_m[line] == 8.0
    for site, pixel in zip((straight, bent), pixels, strict=True):
        in_camera = np.array([[-0.35 - 3.0, 1.32, 8.0 - 2.05]])
        (x_px, y_px), _ = (a[0] for a in project(site.lens, 640, 360, 70.0, in_camera))
        assert pixel == int(y_px) * 640 + int(x_px)
    assert pixels[0] != pixels[1]


def test_luma_is_the_image_and_minus_one_beside_it():
    view = LaneView.of_site(camera_site(320, 180))
    image = np.random.default_rng(1).integers(0, 256, (180, 320, 3), dtype=np.uint8)
    middle = int(point_of(np.array(0.0)))
    line = np.array([0, 3])
    luma = view.luma(image, line, np.array([middle, middle]))
    for found, pixel in zip(luma, view.pixel[line, middle], strict=True):
        red, green, blue = image.reshape(-1, 3)[pixel].tolist()
        assert found == 77 * red + 150 * green + 29 * blue
    beyond = view.luma(image, np.array([0, 0, 0]), np.array([-1, 10_000, 0]))
    assert beyond.tolist() == [-1, -1, -1]


def test_what_an_object_hides_is_not_seen():
    view = LaneView.of_site(camera_site(320, 180))
    image = np.full((180, 320, 3), 90, np.uint8)
    points = np.arange(view.pixel.shape[1])
    box = Detection("truck", 0.9, x_px=200.0, y_px=60.0, width_px=60.0, height_px=100.0)
    luma = view.luma(image, np.array([[8]]), points[None], [box])[0]
    column = view.pixel[8] % 320
    row = view.pixel[8] // 320
    hidden = (column >= 200) & (column <= 260) & (row >= 60) & (row <= 160)
    seen = view.pixel[8] >= 0
    assert (hidden & seen).sum() > 10
    assert (luma[hidden & seen] == -1).all()
    assert (luma[seen & ~hidden] == 90 * 256).all()


def test_points_are_numbered_from_the_right():
    left = np.array([-1.8, 0.0, 1.75])
    assert np.abs(left_of(point_of(left)) - left).max() <= PITCH_M / 2


@pytest.mark.parametrize("roll_rad", [-0.04, 0.015, 0.04])
def test_a_leaning_car_sees_the_road_where_it_is(roll_rad):
    """Places projected by a camera that leans with the car, read as if it did not, put right."""
    site = camera_site()
    view, level = LaneView.of_site(site), CameraView.of_site(site)
    c, s = math.cos(roll_rad), math.sin(roll_rad)
    x, y, z = site.position_m
    eye = np.array([x, c * y - s * z, s * y + c * z])
    axes = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ vehicle_from_camera(site.rotation_deg)
    for ahead_m in (6.0, 10.0, 15.0):
        for left_m in (-3.0, -1.8, 1.75):
            in_camera = (np.array([ahead_m, left_m, 0.0]) - eye) @ axes
            px, _ = project(site.lens, site.width, site.height, site.hfov_deg, in_camera[None])
            depth_m = level.ground_m(*px[0])
            seems = level.forward_m + depth_m, level.across_m(*px[0], depth_m)
            found = view.rolled(*(np.array([value]) for value in seems), roll_rad)
            assert found[0][0] == pytest.approx(ahead_m, abs=0.25)
            assert found[1][0] == pytest.approx(left_m, abs=0.03)
            assert abs(seems[1] - left_m) > 0.02  # what there was to put right
