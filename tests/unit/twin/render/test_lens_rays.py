"""Rays and projection of the lens models, against OpenCV and the paper's matrix."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import pytest

from schemas.sections.lens import Lens
from schemas.sections.lens_curve import intrinsics
from schemas.sections.lens_projection import project, vehicle_from_camera
from twin.render.lens import projection_matrix, ray_table

WIDTH, HEIGHT = 128, 72
BROWN = Lens(model="brown_conrady", k1=-0.28, k2=0.09, p1=1e-3, p2=-8e-4, k3=-0.012)
RATIONAL = Lens(
    model="brown_conrady", fx=0.55, fy=0.97, cx=0.51, cy=0.47, k1=0.4, k2=0.05, k4=0.7, k5=0.1
)
FISHEYE = Lens(model="fisheye", k1=-0.03, k2=0.006, k3=-0.002, k4=2e-4)
OFF_AXIS = Lens(model="frustum", near_m=0.2, left_m=-0.1, right_m=0.16, top_m=0.09, bottom_m=-0.05)
ALL = {
    "pinhole": (Lens(), 70.0),
    "pinhole_fx": (Lens(fx=0.7, fy=1.3, cx=0.45, cy=0.6), 70.0),
    "brown": (BROWN, 80.0),
    "rational": (RATIONAL, 70.0),
    "fisheye": (FISHEYE, 150.0),
    "fisheye_190": (FISHEYE, 190.0),
    "frustum": (OFF_AXIS, 70.0),
    "frustum_of_view": (Lens(model="frustum"), 70.0),
}


def _opencv(lens: Lens, hfov_deg: float, points: np.ndarray) -> np.ndarray:
    """Pixels [N, 2], with centres at half numbers as here."""
    inner = intrinsics(lens, WIDTH, HEIGHT, hfov_deg)
    matrix = np.array(
        [[inner.fx_px, 0, inner.cx_px], [0, inner.fy_px, inner.cy_px], [0, 0, 1]], np.float64
    )
    points = points.astype(np.float64).reshape(-1, 1, 3)
    still = np.zeros(3)
    if lens.model == "fisheye":
        numbers = np.array([lens.k1, lens.k2, lens.k3, lens.k4])
        px, _ = cv2.fisheye.projectPoints(points, still, still, matrix, numbers)
    else:
        names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
        numbers = np.array([getattr(lens, name) for name in names])
        px, _ = cv2.projectPoints(points, still, still, matrix, numbers)
    return px.reshape(-1, 2)


@pytest.mark.parametrize("name", [n for n in ALL if n != "fisheye_190"])
def test_rays_meet_their_pixel_in_opencv(name: str) -> None:
    lens, hfov_deg = ALL[name]
    rays = ray_table(lens, WIDTH, HEIGHT, hfov_deg)
    assert rays.shape == (HEIGHT, WIDTH, 3)
    assert rays.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1.0, atol=1e-6)
    found = _opencv(lens, hfov_deg, rays).reshape(HEIGHT, WIDTH, 2)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    assert np.abs(found - np.stack([columns, rows], axis=-1)).max() < 1e-3


@pytest.mark.parametrize("name", ALL)
def test_projection_is_the_inverse_of_the_rays(name: str) -> None:
    lens, hfov_deg = ALL[name]
    rays = ray_table(lens, WIDTH, HEIGHT, hfov_deg)
    seen = np.abs(rays).sum(axis=-1) > 0.0
    px, visible = project(lens, WIDTH, HEIGHT, hfov_deg, rays[seen] * 7.0)
    rows, columns = np.nonzero(seen)
    assert np.abs(px - np.stack([columns, rows], axis=-1) - 0.5).max() < 1e-3
    assert visible.all()


@pytest.mark.parametrize("name", [n for n in ALL if n != "fisheye_190"])
def test_projection_of_scattered_points_is_that_of_opencv(name: str) -> None:
    lens, hfov_deg = ALL[name]
    rng = np.random.default_rng(5)
    points = rng.uniform((-3, -2, 2), (3, 2, 9), (400, 3))
    px, visible = project(lens, WIDTH, HEIGHT, hfov_deg, points)
    assert visible.sum() > 100
    assert not visible.all()
    assert np.abs(px - _opencv(lens, hfov_deg, points))[visible].max() < 1e-3


@pytest.mark.parametrize("name", ["pinhole", "pinhole_fx", "frustum", "frustum_of_view"])
def test_the_papers_matrix_draws_the_same_picture(name: str) -> None:
    lens, hfov_deg = ALL[name]
    rng = np.random.default_rng(6)
    points = rng.uniform((-3, -2, 0.5), (3, 2, 9), (300, 3))
    matrix = projection_matrix(lens, WIDTH, HEIGHT, hfov_deg)
    view = np.concatenate([points * (1, -1, -1), np.ones((300, 1))], axis=1)
    clip = view @ matrix.T
    clip = clip[:, :3] / clip[:, 3:]
    pixels = (clip[:, :2] * (0.5, -0.5) + 0.5) * (WIDTH, HEIGHT)
    px, visible = project(lens, WIDTH, HEIGHT, hfov_deg, points)
    np.testing.assert_allclose(px, pixels, atol=1e-9)
    np.testing.assert_array_equal(visible, (np.abs(clip) <= 1.0).all(axis=1))


def test_the_matrix_holds_the_planes_as_given() -> None:
    matrix = projection_matrix(OFF_AXIS, WIDTH, HEIGHT, 70.0)
    n, f, l, r, t, b = 0.2, 1200.0, -0.1, 0.16, 0.09, -0.05  # noqa: E741
    expected = [
        [2 * n / (r - l), 0, (r + l) / (r - l), 0],
        [0, 2 * n / (t - b), (t + b) / (t - b), 0],
        [0, 0, -(f + n) / (f - n), -2 * f * n / (f - n)],
        [0, 0, -1, 0],
    ]
    np.testing.assert_allclose(matrix, expected, rtol=1e-12)
    with pytest.raises(ValueError, match="no projection matrix describes a fisheye lens"):
        projection_matrix(FISHEYE, WIDTH, HEIGHT, 70.0)


@pytest.mark.parametrize("name", ["pinhole", "brown", "fisheye", "fisheye_190", "frustum_of_view"])
def test_the_width_covers_the_field_of_view(name: str) -> None:
    lens, hfov_deg = ALL[name]
    half = math.radians(hfov_deg) / 2.0
    edges = np.array([[math.sin(a), 0.0, math.cos(a)] for a in (-half, half)])
    px, _ = project(lens, WIDTH, HEIGHT, hfov_deg, edges)
    # Tangential distortion moves both edges to the same side.
    assert px[1, 0] - px[0, 0] == pytest.approx(WIDTH, abs=1e-6)


def test_beyond_the_image_circle_the_lens_sees_nothing() -> None:
    lens = Lens(model="fisheye", fx=0.25, circle_deg=180.0)
    rays = ray_table(lens, WIDTH, HEIGHT, 70.0)
    dark = np.abs(rays).sum(axis=-1) == 0.0
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    radius = np.hypot(columns - WIDTH / 2, rows - HEIGHT / 2)
    np.testing.assert_array_equal(dark, radius > 0.25 * WIDTH * math.pi / 2)
    points = np.array([[5.0, 0.0, -0.1], [5.0, 0.0, 0.1]])
    assert project(lens, WIDTH, HEIGHT, 70.0, points)[1].tolist() == [False, True]


def test_near_and_far_planes_bound_what_is_visible() -> None:
    lens = Lens(near_m=1.0, far_m=50.0)
    points = np.array([[0, 0, 0.9], [0, 0, 1.1], [0, 0, 49.0], [0, 0, 51.0], [0, 0, -5.0]], float)
    assert project(lens, 64, 36, 70.0, points)[1].tolist() == [False, True, True, False, False]


@pytest.mark.parametrize(
    ("rotation", "forward", "right", "down"),
    [
        ([0, 0, 0], (1, 0, 0), (0, -1, 0), (0, 0, -1)),
        ([0, 0, 90], (0, 1, 0), (1, 0, 0), (0, 0, -1)),
        ([0, 90, 0], (0, 0, -1), (0, -1, 0), (-1, 0, 0)),
        ([90, 0, 0], (1, 0, 0), (0, 0, -1), (0, 1, 0)),
    ],
)
def test_mounts_turn_the_camera(rotation: list, forward: Any, right: Any, down: Any) -> None:
    axes = vehicle_from_camera(rotation)
    np.testing.assert_allclose(axes, np.array([right, down, forward]).T, atol=1e-12)


def test_a_pixel_on_the_axis_of_a_fisheye_looks_straight_ahead():
    """Its angle and its radius are 0: the ratio of the two must not be asked for."""
    rays = ray_table(FISHEYE, 129, 73, 150.0)
    np.testing.assert_allclose(rays[36, 64], (0.0, 0.0, 1.0), atol=1e-7)
    assert np.isfinite(rays).all()
