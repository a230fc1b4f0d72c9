"""twin.road.opendrive.road_frame: superelevation, lanes, level lanes, and the way back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from road_files import LINE, WIDTH, geometry, lane, road, section, xodr
from road_networks import shapes, turned

from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.road_frame import RoadFrame
from twin.road.opendrive.road_map import RoadMap

TILT = 0.1
PROFILES = (
    '<elevationProfile><elevation s="0" a="5" b="0.05" c="0" d="0"/></elevationProfile>'
    f'<lateralProfile><superelevation s="0" a="{TILT}" b="0" c="0" d="0"/></lateralProfile>'
)


def frame(*args: object, **kwargs: object) -> RoadFrame:
    return RoadFrame(read_network(xodr(road(*args, **kwargs)), "t").roads["0"])  # type: ignore[arg-type]


def test_a_superelevated_slope():
    pose = frame(more=PROFILES).pose(20.0, 4.0, 1.0)
    assert float(pose.x_m) == 20.0
    assert float(pose.y_m) == pytest.approx(4 * math.cos(TILT) - math.sin(TILT), abs=1e-9)
    z = 5 + 0.05 * 20 + 4 * math.sin(TILT) + math.cos(TILT)
    assert float(pose.z_m) == pytest.approx(z, abs=1e-9)
    assert float(pose.pitch_rad) == pytest.approx(-math.atan(0.05), abs=1e-9)
    roll = math.atan(math.tan(TILT) * math.cos(math.atan(0.05)))
    assert float(pose.roll_rad) == pytest.approx(roll, abs=1e-9)


def test_the_body_axes_lie_on_the_surface():
    """Pitch and roll against the normal of the surface by finite differences, where it twists."""
    twist = (
        '<elevationProfile><elevation s="0" a="0" b="0.03" c="0.0005" d="0"/></elevationProfile>'
        '<lateralProfile><superelevation s="0" a="0" b="0.002" c="0" d="0"/></lateralProfile>'
    )
    own = frame(100.0, geometry('<arc curvature="0.01"/>', 100.0), more=twist)
    s, t, step = 40.0, 3.0, 1e-3
    pose = own.pose(s, t)

    def place(ds: float, dt: float) -> np.ndarray:
        return np.array([float(v) for v in own.pose(s + ds, t + dt)[:3]])

    normal = np.cross(place(step, 0) - place(-step, 0), place(0, step) - place(0, -step))
    normal /= np.linalg.norm(normal)
    psi, theta, phi = (float(v) for v in pose[3:])
    up = np.array(
        [
            math.cos(psi) * math.sin(theta) * math.cos(phi) + math.sin(psi) * math.sin(phi),
            math.sin(psi) * math.sin(theta) * math.cos(phi) - math.cos(psi) * math.sin(phi),
            math.cos(theta) * math.cos(phi),
        ]
    )
    np.testing.assert_allclose(up, normal, atol=2e-6)


def test_lanes_with_offset_and_taper():
    width = '<width sOffset="{}" a="3" b="{}" c="0" d="0"/>'
    widening = width.format(0, 0) + width.format(20, 0.1)
    lanes = '<laneOffset s="0" a="0.5" b="0" c="0" d="0"/>' + section(
        left="", right=lane(-1, widening) + lane(-2)
    )
    own = frame(lanes=lanes)
    np.testing.assert_allclose(own.lane_width(-1, np.array([0.0, 20.0, 30.0])), [3.0, 3.0, 4.0])
    pose = own.lane_pose(-2, 30.0, 0.25)
    assert float(pose.y_m) == pytest.approx(0.5 - 4.0 - 1.75 + 0.25, abs=1e-9)
    assert float(pose.heading_rad) == pytest.approx(-math.atan(0.1), abs=1e-9)
    assert own.lane_at(30.0, np.array([0.6, 0.5, -3.5, -3.6, -7.1])).tolist() == [0, -1, -1, -2, 0]


def test_borders_instead_of_widths():
    border = '<border sOffset="0" a="{}" b="0" c="0" d="0"/>'
    lanes = section(left="", right=lane(-1, border.format(-3)) + lane(-2, border.format(-7)))
    own = frame(lanes=lanes)
    np.testing.assert_allclose(own.lane_width(np.array([-1, -2]), 5.0), [3.0, 4.0])


@pytest.mark.parametrize("network", [shapes, turned])
def test_all_borders_at_once_are_those_of_each_lane(network):
    for road_frame in RoadMap(network()).frames.values():
        for cross in road_frame.sections:
            s = np.linspace(cross.section.start_m, cross.section.end_m, 9)
            borders = cross.borders(s)
            assert list(borders) == sorted(borders, reverse=True)
            assert len(borders) == len(cross.section.lanes) + 1
            for lane_id, t in borders.items():
                np.testing.assert_array_equal(t, cross.outer(lane_id, s)[0])


def test_traffic_goes_right_or_left():
    right = frame().lane_pose(np.array([1, -1]), 10.0, with_traffic=True).heading_rad
    left = frame(attributes='rule="LHT"').lane_pose(np.array([1, -1]), 10.0, with_traffic=True)
    np.testing.assert_allclose(right, [-math.pi, 0.0], atol=1e-8)
    np.testing.assert_allclose(left.heading_rad, [0.0, -math.pi], atol=1e-8)


def test_pitch_and_roll_turn_with_the_traffic():
    own = frame(more=PROFILES)
    along, against = own.lane_pose(1, 10.0), own.lane_pose(1, 10.0, with_traffic=True)
    assert float(against.pitch_rad) == -float(along.pitch_rad) != 0.0
    assert float(against.roll_rad) == -float(along.roll_rad) != 0.0


def test_level_lanes_stay_level():
    level = '<lane id="-2" type="sidewalk" level="true">' + WIDTH + "</lane>"
    own = frame(lanes=section(right=lane(-1) + level), more=PROFILES)
    edge, beyond = own.pose(10.0, -3.5), own.pose(10.0, -5.5)
    assert float(beyond.z_m) == float(edge.z_m)
    assert float(beyond.y_m) == pytest.approx(float(edge.y_m) - 2.0, abs=1e-9)
    assert float(beyond.roll_rad) == pytest.approx(0.0, abs=1e-9)
    back = own.locate(beyond.x_m, beyond.y_m, np.asarray(beyond.z_m) + 0.5)
    assert float(back.t_m) == pytest.approx(-5.5, abs=1e-8)
    assert float(back.h_m) == pytest.approx(0.5, abs=1e-8)


def test_lane_heights_lift_and_tilt():
    kerb = WIDTH + '<height sOffset="0" inner="0.1" outer="0.2"/>'
    own = frame(lanes=section(right=lane(-1) + lane(-2, kerb, "sidewalk")))
    pose = own.lane_pose(-2, 10.0)
    assert float(pose.z_m) == pytest.approx(0.15, abs=1e-9)
    assert float(pose.roll_rad) == pytest.approx(-math.atan(0.1 / 3.5), abs=1e-9)


def test_hints_keep_a_point_on_its_branch():
    """A spiral road that passes over itself."""
    length = 2 * math.pi * 30.0 * 1.5
    own = frame(length, geometry(f'<arc curvature="{1 / 30!r}"/>', length))
    circle = 2 * math.pi * 30.0
    pose = own.pose(20.0, 1.0)
    first = own.locate(pose.x_m, pose.y_m, near_s_m=22.0)
    second = own.locate(pose.x_m, pose.y_m, near_s_m=circle + 22.0)
    assert float(first.s_m) == pytest.approx(20.0, abs=1e-7)
    assert float(second.s_m) == pytest.approx(circle + 20.0, abs=1e-7)


def test_no_such_lane():
    with pytest.raises(ValueError, match=r"road 0 has no lane 3 at s=5 m; it has 1, -1"):
        frame().lane_pose(3, 5.0)


def test_a_station_between_sections_belongs_to_the_second():
    lanes = section() + section(40.0, right=lane(-1) + lane(-2))
    own = frame(100.0, geometry(LINE, 100.0), lanes)
    assert own.section_at(np.array([0.0, 39.999, 40.0])).tolist() == [0, 0, 1]
    assert own.lane_at(np.array([39.9, 40.0]), -5.0).tolist() == [0, -2]
