"""The lane in painted pictures: markings, the curve through them, and what is no marking."""

from __future__ import annotations

import math

import numpy as np
import pytest
from camera_sites import camera_site
from lane_pictures import LanePainter

from devkit.lane.curve import PRIOR, LaneCurve, fit
from devkit.lane.lateral import LateralParameters
from devkit.lane.lines import find_points
from devkit.lane.track import CarMotion, Chassis, LaneTrack
from devkit.lane.view import LaneView
from twin.road.lane import Piece, straight, trace

LINES = LateralParameters().lines_m
STIFF = Chassis(0.0, 0.0)
RADII = {"straight": 0.0, "left": 1 / 25.0, "right": -1 / 25.0, "wide": 1 / 60.0}


def arc(curvature):
    if not curvature:
        return straight(-50.0, 150.0)
    piece = Piece(math.pi / abs(curvature), curvature)
    return trace((-50.0, 0.0, 0.0), [Piece(50.0, 0.0), piece, Piece(50.0, 0.0)])


def watch(size, lane, s_m, offset_m=0.0, heading_rad=0.0, frames=10, speed_mps=8.0):
    """A car that rolls along, parallel to the lane; its track, and its last pose."""
    site = camera_site(*size)
    painter = LanePainter(site, lane)
    track = LaneTrack(LaneView.of_site(site), LINES, STIFF)
    for frame in range(frames):
        pose = lane.at(s_m + frame * speed_mps * 0.1, offset_m)
        yaw_rad = float(pose.yaw_rad) + heading_rad
        yaw_rate = float(pose.curvature_per_m) * speed_mps
        image = painter.picture(float(pose.x_m), float(pose.y_m), yaw_rad)
        curve = track.update(CarMotion(speed_mps, yaw_rate), image, 0.1)
    return track, curve, (float(pose.x_m), float(pose.y_m), yaw_rad)


def error_m(lane, curve, pose, ahead_m):
    """How far beside the lane's centre a point of the curve lies [m]."""
    left_m = curve.left_m(ahead_m)
    x, y, yaw = pose
    c, s = math.cos(yaw), math.sin(yaw)
    place = lane.locate(x + c * ahead_m - s * left_m, y + s * ahead_m + c * left_m)
    return float(place.lateral_m)


@pytest.mark.parametrize("size", [(640, 360), (320, 180)], ids=["640", "320"])
@pytest.mark.parametrize("curvature", RADII.values(), ids=RADII)
def test_the_curve_is_the_lanes_centre(size, curvature):
    lane = arc(curvature)
    track, curve, pose = watch(size, lane, 40.0, frames=28)
    assert track.known
    # Below 5 m the picture shows nothing, and the car has not driven there yet.
    for ahead_m, limit_m in ((2.0, 0.12), (6.0, 0.06), (10.0, 0.06)):
        assert abs(error_m(lane, curve, pose, ahead_m)) < limit_m, ahead_m
    assert curve.bend_per_m(12.0) == pytest.approx(curvature, abs=0.006)


@pytest.mark.parametrize("offset_m", [-0.5, 0.4])
@pytest.mark.parametrize("heading_rad", [-0.04, 0.05])
def test_offset_and_heading_of_the_car(offset_m, heading_rad):
    lane = straight(-50.0, 150.0)
    # Standing, so that the heading does not move it.
    _, curve, _ = watch((320, 180), lane, 20.0, offset_m, heading_rad, speed_mps=0.0)
    a, b, _, _ = curve.coefficients
    assert a == pytest.approx(-offset_m / math.cos(heading_rad), abs=0.08)
    assert b == pytest.approx(-math.tan(heading_rad), abs=0.02)
    assert curve.left_m(7.0) == pytest.approx(
        -offset_m / math.cos(heading_rad) - 7.0 * math.tan(heading_rad), abs=0.04
    )


@pytest.mark.parametrize(
    "picture",
    ["nothing", "noise", "edge of a shadow", "bright strip"],
)
def test_what_is_no_marking_is_no_lane(picture):
    site = camera_site(320, 180)
    lane = straight(-50.0, 150.0)
    image = LanePainter(site, lane).picture(0.0, 0.0, 0.0, painted=False)
    if picture == "noise":
        image = np.random.default_rng(3).integers(0, 256, image.shape, dtype=np.uint8)
    if picture == "edge of a shadow":
        image[:, 200:] = 40
    if picture == "bright strip":
        image[90:, 180:260] = 190  # much wider than a marking
    track = LaneTrack(LaneView.of_site(site), LINES, STIFF)
    for _ in range(10):
        assert track.update(CarMotion(0.0, 0.0), image, 0.1) is None
    assert track.curve == LaneCurve()


def test_only_markings_are_found_and_each_once_per_line():
    site = camera_site(640, 360)
    view = LaneView.of_site(site)
    image = LanePainter(site, straight(-50.0, 150.0)).picture(0.0, 0.0, 0.0)
    points = find_points(image, view, LaneCurve(), LINES, 0.5)
    right = points.line_m < 0.0
    assert np.abs(points.left_m[right] + 1.8).max() < 0.06
    assert np.abs(points.left_m[~right] - 1.75).max() < 0.06
    assert right.sum() == len(view.ahead_m)  # the edge line has no gaps
    # The dashes lie at 5 to 7.5, 10 to 12.5 m and so on of the way from -50 m on.
    dashed = (points.ahead_m[~right] + 50.0) % 7.5
    assert ((dashed < 3.4) | (dashed > 7.1)).all()


def test_the_map_is_carried_along_while_nothing_is_seen():
    lane = arc(1 / 25.0)
    track, _, (x, y, yaw) = watch((320, 180), lane, 40.0, frames=28)
    speed, rate = 8.0, 8.0 / 25.0
    curve = None
    for _ in range(10):  # half a second on the same arc
        x += speed * 0.05 * math.cos(yaw + rate * 0.025)
        y += speed * 0.05 * math.sin(yaw + rate * 0.025)
        yaw += rate * 0.05
        curve = track.update(CarMotion(speed, rate), None, 0.05)
    assert curve is not None
    assert abs(error_m(lane, curve, (x, y, yaw), 4.0)) < 0.1
    for _ in range(100):
        curve = track.update(CarMotion(speed, rate), None, 0.05)
    assert curve is None


def test_a_track_does_not_depend_on_others():
    lane = arc(-1 / 25.0)
    alone, again = (watch((320, 180), lane, 40.0, frames=20)[0].curve for _ in range(2))
    assert alone == again


def test_fit_is_the_least_squares_solution():
    rng = np.random.default_rng(2)
    x = rng.uniform(-3.0, 16.0, 400)
    truth = LaneCurve((0.3, -0.05, 0.02, 0.001))
    noisy = truth.left_m(x) + 0.01 * rng.standard_normal(400)
    weight = rng.uniform(0.1, 1.0, 400)
    basis = np.stack([np.ones_like(x), x, x**2 / 2, x**3 / 6], axis=1)
    prior = np.diag((0.1 / np.array(PRIOR)) ** 2)
    expected = np.linalg.solve(
        basis.T @ (basis * weight[:, None]) + prior, basis.T @ (weight * noisy)
    )
    assert fit(x, noisy, weight).coefficients == pytest.approx(expected.tolist(), abs=1e-9)
    assert fit(np.zeros(0), np.zeros(0), np.zeros(0)) == LaneCurve()
