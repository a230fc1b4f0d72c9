"""devkit.lane.lateral: keeps a painted lane in closed loop, lets go gently without one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from camera_sites import camera_site
from lane_pictures import LanePainter

from devkit.lane.curve import LaneCurve
from devkit.lane.lateral import LateralParameters, Wheel, steer
from devkit.lane.track import CarMotion, LaneTrack
from devkit.lane.view import LaneView
from twin.road.lane import Piece, trace

PERIOD_S = 0.05
STEERING = LateralParameters(
    steering="visual",
    roll_rad_per_mps2=0.0,
    sideslip_rad_per_mps2=0.0,
    understeer_rad_per_mps2=0.0,
)
"""For a car without tyres and springs."""


def drive(lane, way_m, start=(0.0, 0.0), speed_mps=8.0, steering=STEERING, blind_m=math.inf):
    """A bicycle with a lag of 0.1 s in its steering; rows of station, lateral, angle, known."""
    site = camera_site(320, 180)
    painter = LanePainter(site, lane)
    track = LaneTrack(LaneView.of_site(site), steering.lines_m, steering.chassis)
    pose = lane.at(0.0, start[0])
    x, y, yaw = float(pose.x_m), float(pose.y_m), float(pose.yaw_rad) + start[1]
    wheel, angle, rate, rows = Wheel(), 0.0, 0.0, []
    while True:
        place = lane.locate(x, y)
        rows.append((float(place.s_m), float(place.lateral_m), wheel.angle_rad, track.known))
        if rows[-1][0] > way_m or abs(rows[-1][1]) > 3.0:
            return np.array(rows)
        due = len(rows) % 2 == 1
        painted = rows[-1][0] < blind_m
        image = painter.picture(x, y, yaw, painted=painted) if due else None
        curve = track.update(CarMotion(speed_mps, rate), image, PERIOD_S)
        wheel = steer(wheel, curve, track.bend, speed_mps, PERIOD_S, steering)
        for _ in range(5):
            angle += (wheel.angle_rad - angle) * 0.01 / 0.1
            rate = speed_mps * math.tan(angle) / steering.wheelbase_m
            x += speed_mps * 0.01 * math.cos(yaw)
            y += speed_mps * 0.01 * math.sin(yaw)
            yaw += rate * 0.01


@pytest.mark.slow
def test_keeps_a_lane_with_narrow_bends_both_ways():
    bend = math.pi / 2 * 22.0
    lane = trace(
        (0.0, 0.0, 0.0),
        [
            Piece(15.0, 0.0),
            Piece(bend, 1 / 22.0),
            Piece(12.0, 0.0),
            Piece(bend, -1 / 22.0),
            Piece(40.0, 0.0),
        ],
    )
    rows = drive(lane, 2 * bend + 45.0)
    assert rows[:, 3].mean() > 0.98
    assert np.sqrt((rows[:, 1] ** 2).mean()) < 0.12
    assert np.abs(rows[:, 1]).max() < 0.3


@pytest.mark.parametrize("start", [(0.5, 0.0), (-0.4, 0.05)])
def test_returns_to_the_middle_and_stays_there(start):
    lane = trace((0.0, 0.0, 0.0), [Piece(200.0, 0.0)])
    rows = drive(lane, 50.0, start)
    assert np.abs(rows[rows[:, 0] > 30.0, 1]).max() < 0.05


def test_without_markings_the_bend_is_driven_on_and_let_go_of():
    lane = trace((0.0, 0.0, 0.0), [Piece(15.0, 0.0), Piece(120.0, 1 / 40.0), Piece(9.0, 0.0)])
    rows = drive(lane, 70.0, blind_m=35.0)
    steps = np.abs(np.diff(rows[:, 2]))
    assert steps.max() <= STEERING.steering_rate_radps * PERIOD_S + 1e-12
    held = rows[(rows[:, 0] > 40.0) & (rows[:, 0] < 43.0)]
    assert np.abs(held[:, 1]).max() < 0.3
    lost = rows[(rows[:, 3] == 0.0) & (rows[:, 0] > 35.0)][2:]
    assert len(lost) > 10
    assert np.diff(lost[:, 2]).max() <= 1e-12  # never more than it was
    assert lost[-1, 2] < 0.5 * rows[rows[:, 0] < 35.0][-1, 2]


def test_where_there_never_was_a_marking_the_wheel_stays_straight():
    lane = trace((0.0, 0.0, 0.0), [Piece(200.0, 0.0)])
    rows = drive(lane, 20.0, blind_m=-1.0)
    assert not rows[:, 2].any()


def test_the_angle_is_that_of_the_arc_through_the_lane_ahead():
    steering = LateralParameters(steering="visual", steering_rate_radps=10.0)
    speed_mps, ahead_m = 10.0, 7.0
    bend = LaneCurve((0.0, 0.0, 0.02, 0.0))
    left_m = 0.01 * ahead_m**2
    curvature = 2.0 * left_m / (ahead_m**2 + left_m**2)
    angle = math.atan(3.09 * curvature) + 0.003 * curvature * speed_mps**2
    wheel = steer(Wheel(), bend, bend, speed_mps, 0.05, steering)
    assert wheel.angle_rad == pytest.approx(angle, abs=1e-8)
    assert wheel.bend_per_m == pytest.approx(0.02 * 0.05 / 0.3)
    # At a crawl the point does not come nearer than 4 m.
    slow = steer(Wheel(), LaneCurve((0.4, 0.0, 0.0, 0.0)), None, 0.0, 0.05, steering)
    assert slow.angle_rad == pytest.approx(math.atan(3.09 * 0.8 / 16.16), abs=1e-8)


def test_limits_of_angle_and_rate():
    far_left = LaneCurve((5.0, 0.0, 0.0, 0.0))
    wheel = Wheel()
    angles = [
        (
            wheel := steer(
                wheel, far_left, None, 5.0, PERIOD_S, LateralParameters(steering="visual")
            )
        ).angle_rad
        for _ in range(40)
    ]
    assert angles[0] == pytest.approx(0.025)
    assert max(np.diff(angles)) <= 0.025 + 1e-12
    assert angles[-1] == 0.6


def test_straight_holds_the_wheel_and_refuses_what_it_would_ignore():
    straight = LateralParameters(steering="straight")
    assert steer(Wheel(), LaneCurve((1.0, 0.0, 0.0, 0.0)), None, 8.0, 0.05, straight) == Wheel()
    with pytest.raises(ValueError, match="lane_width_m is set, but steering: straight"):
        LateralParameters(steering="straight", lane_width_m=3.0)


def test_a_bend_fades_in_seconds_whatever_the_rate():
    """Without a lane its curvature falls to 1 / e in about ``fade_s``."""
    for period_s in (0.05, 0.01):
        wheel, ticks = Wheel(bend_per_m=0.02), round(STEERING.fade_s / period_s)
        for _ in range(ticks):
            wheel = steer(wheel, None, None, 8.0, period_s, STEERING)
        expected = 0.02 / (1.0 + period_s / STEERING.fade_s) ** ticks
        assert wheel.bend_per_m == pytest.approx(expected, rel=1e-9)
        assert wheel.bend_per_m == pytest.approx(0.02 / math.e, rel=0.05)
