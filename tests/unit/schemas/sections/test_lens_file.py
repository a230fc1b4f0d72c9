"""Lenses in files: defaults, and one line for every mistake."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from schemas.sections.lens import CameraMount, Lens
from schemas.sections.lens_curve import check_lens, curve, intrinsics, radial, reach
from schemas.validation import convert_all


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"model": "fish"}, "did you mean 'fisheye'?"),
        ({"near_m": 5, "far_m": 2}, "far_m must be larger than near_m"),
        ({"k1": 0.1}, "k1 0.1 with model pinhole: k1 belongs to brown_conrady or fisheye"),
        ({"model": "fisheye", "p1": 0.1}, "p1 belongs to brown_conrady"),
        ({"model": "frustum", "fx": 0.5}, "fx belongs to pinhole or brown_conrady or fisheye"),
        ({"left_m": -0.1}, "left_m belongs to frustum"),
        ({"model": "frustum", "left_m": 0.1, "right_m": 0.05}, "right_m must be larger"),
        ({"f_number": 0}, "a number >= 0.5 and <= 64"),
        ({"aperture": 2}, "unknown key"),
    ],
)
def test_mistakes_in_a_lens_are_one_line(data: dict[str, Any], words: str) -> None:
    lens, mistakes = convert_all(data, Lens)
    assert lens is None
    assert len(mistakes) == 1
    line = mistakes[0].line("car.yaml")
    assert words in line
    assert "\n" not in line


def test_a_mount_reads_as_written() -> None:
    data = {"position_m": [1.5, 0.4, 1.2], "rotation_deg": [0, 5, -10], "lens": {"fx": 0.8}}
    mount, mistakes = convert_all(data, CameraMount)
    assert mistakes == []
    assert mount == CameraMount([1.5, 0.4, 1.2], [0, 5, -10], Lens(fx=0.8))
    _, mistakes = convert_all({"position_m": [1.5, 0.4]}, CameraMount)
    assert "position_m" in mistakes[0].line("car.yaml")


def test_a_curve_that_turns_back_inside_the_image_is_refused() -> None:
    lens = Lens(model="brown_conrady", k1=-0.3)
    check_lens(lens, 640, 360, 60.0)
    # r (1 - 0.3 r^2) rises up to r = 1.054, where it is 0.703.
    with pytest.raises(ValueError, match=r"turns back 46\.5 deg off the axis at 0\.703"):
        check_lens(lens, 640, 360, 90.0)
    with pytest.raises(ValueError, match="its image ends at 93"):
        check_lens(lens, 640, 360, 100.0)
    fisheye = Lens(model="fisheye", fx=0.3, k1=-0.2)  # rises up to theta = 1.29
    with pytest.raises(ValueError, match=r"the image's edge is at 1\.67"):
        check_lens(fisheye, 640, 360, 90.0)
    check_lens(Lens(model="fisheye", fx=0.3, circle_deg=120.0), 640, 360, 90.0)


def test_a_field_of_view_beyond_the_model_is_refused() -> None:
    with pytest.raises(ValueError, match="hfov_deg 185 with a pinhole lens"):
        intrinsics(Lens(), 640, 360, 185.0)
    inner = intrinsics(Lens(model="fisheye"), 640, 360, 185.0)
    assert inner.fx_px == inner.fy_px


def test_a_lens_fits_every_resolution() -> None:
    lens = Lens(fx=0.8, cx=0.4)
    small, large = (intrinsics(lens, w, h, 70.0) for w, h in ((320, 180), (1280, 720)))
    assert large.fx_px == 4 * small.fx_px == 1024.0
    assert (large.cx_px, large.cy_px) == (4 * small.cx_px, 4 * small.cy_px) == (512.0, 360.0)


@pytest.mark.parametrize(
    "lens", [Lens(model="brown_conrady", k1=-0.3), Lens(model="fisheye", k1=-0.2)]
)
def test_a_lens_ends_where_its_curve_turns_back(lens: Lens) -> None:
    arguments, radii = curve(lens)
    assert len(arguments) == len(radii)
    assert (np.diff(radii) > 0.0).all()
    further = arguments[-1] + (arguments[-1] - arguments[-2])
    assert radial(lens, np.array([further]))[0] <= radii[-1]
    assert (reach(lens).argument, reach(lens).radius) == (arguments[-1], radii[-1])
