"""devkit.fusion: from LiDAR points, camera boxes and radar detections to places on the road."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from camera_sites import camera_site
from fused_drives import HEIGHT, ROOF, WIDTH, MadeUpCase, Thing

from devkit.fusion.camera_objects import distance_m, ends_m, place_boxes
from devkit.fusion.lidar_objects import SweepObjects, find_objects
from devkit.fusion.lidar_points import LidarView, ground
from devkit.fusion.parameters import FusionSensors
from devkit.fusion.path import CarPath
from devkit.fusion.radar_objects import EchoGroup, Mounts, RadarView, group_frames
from devkit.fusion.sightings import LABELS, Sightings
from devkit.reference.view import CameraView
from schemas.messages import Detection

VIEW = LidarView.of_site(ROOF)
EYE = CameraView.of_site(camera_site(WIDTH, HEIGHT))
RADAR = RadarView((4.1, 0.0, 0.5), 0.0)


def objects(points: np.ndarray, **changes) -> SweepObjects:
    settings = {
        "speed_mps": 8.0, "path": CarPath(0.0), "corridor_half_m": 1.1, "range_m": 60.0,
        "points_min": 4, "deskewed": True,
    }  # fmt: skip
    return find_objects(points, VIEW, **(settings | changes))


def test_obstacles_are_found_within_centimetres_nearest_first():
    seen = objects(MadeUpCase(1, [Thing(25.0, 0.2), Thing(14.0, -2.8)]).sweep(0.0))
    assert seen.x_m == pytest.approx([14.0, 25.0], abs=0.05)
    assert seen.inside.tolist() == [False, True]
    # Edges are a column short at most, and the outermost points are left out.
    assert seen.left_m[1] == pytest.approx(0.2 + 0.9, abs=0.35)
    assert seen.left_m[0] == pytest.approx(-2.8 + 0.9, abs=0.25)
    assert 0.9 < seen.returned * 1.35 < 1.1


def test_an_empty_road_has_no_obstacles_also_when_the_car_pitches():
    points = MadeUpCase(1).sweep(0.0)
    assert not len(objects(points).x_m)
    pitch = math.radians(2.0)
    pitched = points.copy()
    x, z = points[:, 0], points[:, 2]
    pitched[:, 0] = math.cos(pitch) * x - math.sin(pitch) * (z + 1.93)
    pitched[:, 2] = math.sin(pitch) * x + math.cos(pitch) * (z + 1.93) - 1.93
    assert not len(objects(pitched).x_m)
    flat = pitched[(pitched[:, 0] > 20.0) & (pitched[:, 2] + 1.93 > 0.3)]
    assert len(flat) > 100, "without the fit these would be obstacles"


def test_the_ground_is_a_line_with_the_cars_pitch():
    x = np.linspace(5.0, 25.0, 400)
    height, slope = ground(x, 0.05 + 0.03 * x)
    assert (height, slope) == pytest.approx((0.05, 0.03), abs=1e-9)
    assert ground(x[:10], x[:10]) == (0.0, 0.0)


def test_scattered_returns_are_no_obstacle():
    rng = np.random.default_rng(3)
    points = MadeUpCase(1).sweep(0.0)
    fog = rng.choice(len(points), 700, replace=False)
    angle, range_m = rng.uniform(-0.5, 0.5, 700), rng.uniform(3.0, 18.0, 700)
    points[fog, 0], points[fog, 1] = range_m * np.cos(angle), range_m * np.sin(angle)
    points[fog, 2] = rng.uniform(-1.6, 0.2, 700)
    assert not objects(points).inside.any()


def test_points_of_a_moving_car_are_put_where_they_are_at_the_tick():
    points = MadeUpCase(1, [Thing(25.0, 0.0)]).sweep(0.0)
    points[:, 5] = -0.05
    moved = objects(points, speed_mps=10.0, deskewed=False)
    assert moved.x_m == pytest.approx([24.5], abs=0.05)


def test_a_path_that_bends_decides_what_is_inside():
    points = MadeUpCase(1, [Thing(25.0, 3.1)]).sweep(0.0)
    assert not objects(points).inside.any()
    assert objects(points, path=CarPath(0.01)).inside.all()


def test_who_may_come_from_far_beside_the_road_is_seen_and_stands_last():
    """At 8 m/s the car is 20.8 m ahead after 2.6 s."""
    lorry, rest = Thing(12.0, -20.0, 4.0, vy_mps=8.0), Thing(14.0, 0.0)
    seen = objects(MadeUpCase(1, [lorry, rest]).sweep(0.0))
    assert seen.x_m == pytest.approx([14.0, 12.0], abs=0.05)
    assert seen.beside.tolist() == [False, True]
    assert seen.right_m[1] == pytest.approx(-22.0, abs=0.6)
    assert seen.left_m[1] == pytest.approx(-18.0, abs=0.6)
    assert seen.reach_m == pytest.approx(14.0, abs=0.05), "that of the road"


@pytest.mark.parametrize(
    ("thing", "why"),
    [
        (Thing(30.0, -20.0, 4.0), "the car is not there soon"),
        (Thing(6.0, -25.0, 4.0), "the car is there before anybody"),
        (Thing(12.0, -20.0, 12.0), "a wall"),
        (Thing(12.0, -40.0, 4.0), "too far aside"),
    ],
)
def test_what_cannot_cross_is_not_looked_for_beside_the_road(thing, why):
    assert len(objects(MadeUpCase(1, [thing]).sweep(0.0)).x_m) == 0, why


def test_what_is_long_is_looked_at_along_the_road_only():
    seen = objects(MadeUpCase(1, [Thing(15.0, -12.0, 14.0)]).sweep(0.0))
    assert seen.beside.tolist() == [False]
    assert seen.right_m[0] > -9.0
    assert seen.left_m[0] == pytest.approx(-5.0, abs=0.3)


def test_no_returns_are_no_objects():
    seen = objects(MadeUpCase(1, lidar_dead_s=0.0).sweep(0.0))
    assert (len(seen.x_m), seen.free_to_m, seen.returned) == (0, 0.0, 0.0)


def test_a_lidar_that_looks_aside_is_turned():
    view = LidarView.of_site(msgspec.structs.replace(ROOF, rotation_deg=[0.0, 0.0, 90.0]))
    (ax, ay, _), (bx, by, _), _ = view.rotation
    assert (ax, bx) == pytest.approx((0.0, 1.0))
    assert (ay, by) == pytest.approx((-1.0, 0.0))


def box_of(thing: Thing) -> Detection:
    (row,) = MadeUpCase(1, [thing]).box_rows(0.0)
    return Detection("car", 0.9, *row[1:5])


def test_a_box_tells_the_distance_by_foot_and_size():
    for x_m in (12.0, 20.0, 30.0):
        distance = distance_m(box_of(Thing(x_m, 0.0)), EYE)
        assert distance is not None
        assert distance[0] == pytest.approx(x_m - EYE.forward_m, rel=0.05)
        assert 0.02 < distance[1] / distance[0] < 0.25


def test_a_box_with_a_wrong_foot_is_put_right_by_its_size():
    box = box_of(Thing(25.0, 0.0))
    foot = EYE.ground_m(80.0, box.y_px + box.height_px + 2.0)
    lower = Detection("car", 0.9, box.x_px, box.y_px + 2.0, box.width_px, box.height_px)
    distance = distance_m(lower, EYE)
    assert foot is not None
    assert distance is not None
    assert abs(distance[0] - 22.95) < abs(foot - 22.95)


def test_a_box_that_the_border_cuts_off_is_as_wide_as_its_label():
    right_m, left_m = ends_m(Detection("truck", 0.9, 140.0, 20.0, 20.0, 50.0), EYE, 6.0)
    assert left_m - right_m >= 2.5


@pytest.mark.parametrize(
    "box",
    [
        Detection("traffic_sign", 0.9, 70, 40, 20, 20),
        Detection("car", 0.3, 70, 40, 20, 20),
        Detection("car", 0.9, 70, 45, 20, 5),
    ],
)
def test_what_is_no_sure_road_user_is_left_out(box):
    seen = Sightings.empty(1, 4)
    place_boxes(seen, 0, [box], EYE, CarPath(0.0), 1.1, FusionSensors())
    assert not seen.valid.any()


def test_boxes_are_sorted_and_keep_their_place():
    seen = Sightings.empty(1, 4)
    boxes = [box_of(Thing(30.0, 0.0)), box_of(Thing(12.0, -2.6))]
    place_boxes(seen, 0, boxes, EYE, CarPath(0.0), 1.1, FusionSensors())
    assert seen.place[0, :2].tolist() == [1, 0]
    assert seen.inside[0, :2].tolist() == [False, True]
    assert LABELS[seen.label[0, 0]] == "car"


def detections(*rows: tuple[float, ...]) -> np.ndarray:
    return np.array(rows, np.float32).reshape(-1, 6)


def group_detections(
    rows: np.ndarray, view: RadarView, speed_mps: float, yaw_rate: float, dive_rad: float = 0.0
) -> list[EchoGroup]:
    """Objects of one frame."""
    mounts = Mounts(*(np.array([value]) for value in (speed_mps, yaw_rate, dive_rad)))
    return group_frames([rows], view, mounts)[0]


def test_radar_tells_standing_from_moving_by_the_cars_speed():
    rows = detections((30.0, 0.0, 0.0, -10.0, 10.0, 20.0), (50.0, 0.02, 0.0, -4.0, 10.0, 20.0))
    near, far = group_detections(rows, RADAR, 10.0, 0.0)
    assert near.over_ground_mps == pytest.approx(0.0)
    assert far.over_ground_mps == pytest.approx(6.0, abs=0.01)
    assert near.x_m == pytest.approx(34.1)


def test_radar_groups_what_is_near_and_takes_the_speed_of_the_strongest():
    rows = detections(
        *((30.0, 0.01 * n, 0.0, -3.0, 10.0, 20.0) for n in range(3)),
        (30.5, 0.01, 0.0, 4.0, 0.0, 20.0),  # a wheel
        (40.0, 0.01, 0.0, -10.0, 10.0, 20.0),
    )
    groups = group_detections(rows, RADAR, 10.0, 0.0)
    assert [round(group.over_ground_mps, 2) for group in groups] == [7.0, 0.0]
    assert groups[0].speed_sigma_mps > groups[1].speed_sigma_mps == pytest.approx(0.3)


def test_what_comes_and_what_drives_ahead_are_two_however_near():
    ahead, comes = (36.0, -0.03, 0.0, 0.0, 10.0, 20.0), (36.5, 0.02, 0.0, -20.0, 15.0, 20.0)
    wheel = (36.5, 0.03, 0.0, -14.0, 0.0, 20.0)
    groups = group_detections(detections(ahead, comes, wheel), RADAR, 10.0, 0.0)
    assert [round(group.over_ground_mps) for group in groups] == [10, -10]
    assert groups[1].left_m - groups[1].right_m < 1.0


def test_echoes_of_the_road_tell_the_error_of_the_cars_own_speed():
    road = [(8.0 + n, 0.03 * (-1) ** n, 0.0, -10.0, -30.0, 15.0) for n in range(8)]
    rows = detections(*road, (30.0, 0.0, 0.0, -10.0, 10.0, 20.0))
    (car,) = group_detections(rows, RADAR, 9.0, 0.0)
    assert car.over_ground_mps == pytest.approx(0.0, abs=0.05)
    few = detections(*road[:5], rows[-1])
    assert group_detections(few, RADAR, 9.0, 0.0)[0].over_ground_mps == pytest.approx(-1.0)


def test_who_walks_on_the_footway_does_not_tell_the_cars_speed():
    """A dozen weak echoes of his limbs, and a few of the road."""
    limbs = [(15.0 + 0.1 * n, -0.2, 0.0, -8.3, -14.0, 20.0) for n in range(12)]
    road = [(6.0 + 2.0 * n, 0.0, 0.0, -10.0, -30.0, 15.0) for n in range(7)]
    rows = detections(*limbs, *road, (30.0, 0.0, 0.0, -10.0, 10.0, 20.0))
    groups = group_detections(rows, RADAR, 10.0, 0.0)
    assert groups[-1].over_ground_mps == pytest.approx(0.0, abs=0.05)
    assert groups[0].over_ground_mps == pytest.approx(1.5, abs=0.1)


def test_nobody_has_so_weak_an_echo():
    walker, mouse = (30.0, 0.0, 0.0, -8.5, -24.0, 20.0), (30.0, 0.0, 0.0, -8.5, -26.0, 20.0)
    assert len(group_detections(detections(walker), RADAR, 10.0, 0.0)) == 1
    assert group_detections(detections(mouse), RADAR, 10.0, 0.0) == []


@pytest.mark.parametrize(
    "row",
    [
        (30.0, 0.0, 0.15, -10.0, 10.0, 20.0),  # a bridge
        (30.0, 0.0, -0.1, -10.0, 10.0, 20.0),  # below the road: a mirror image
        (30.0, 0.8, 0.0, -7.0, 10.0, 20.0),  # beside the road, where nothing moves
        (60.0, 0.8, 0.0, -17.0, 10.0, 20.0),  # so far beside it that nobody crosses in time
        (30.0, 0.0, 0.0, -10.0, -9.0, 20.0),  # a can
        (math.nan, 0.0, 0.0, -10.0, 10.0, 20.0),
    ],
)
def test_radar_leaves_out_what_is_not_on_the_road(row):
    assert group_detections(detections(row), RADAR, 10.0, 0.0) == []


def test_radar_looks_far_aside_for_what_moves():
    """26 m ahead of the radar and 20 m aside, at 10 m/s towards the car's way, which has 10 m/s."""
    angle, range_m = math.atan2(-20.0, 26.0), math.hypot(20.0, 26.0)
    radial = 10.0 * math.sin(angle) - 10.0 * math.cos(angle)
    car = (range_m, angle, 0.0, radial, 10.0, 20.0)
    ahead = (50.0, 0.0, 0.0, -10.0, 10.0, 20.0)
    along, beside = group_detections(detections(car, ahead), RADAR, 10.0, 0.0)
    assert (along.beside, beside.beside) == (False, True)
    assert beside.over_ground_mps == pytest.approx(10.0 * math.sin(angle), abs=0.01)
    stands = (range_m, angle, 0.0, -10.0 * math.cos(angle), 10.0, 20.0)
    assert group_detections(detections(stands), RADAR, 10.0, 0.0) == []


def test_no_detections_are_no_groups():
    assert group_detections(detections(), RADAR, 10.0, 0.0) == []


def test_what_looks_high_because_the_nose_dives_is_on_the_road():
    """At 66 m with 0.036 rad an echo seems to come from 2.9 m; a bridge is higher by all means."""
    car, bridge = (66.0, 0.0, 0.036, -30.0, 10.0, 40.0), (66.0, 0.0, 0.12, -10.0, 10.0, 40.0)
    assert group_detections(detections(car), RADAR, 10.0, 0.0) == []
    (found,) = group_detections(detections(car, bridge), RADAR, 10.0, 0.0, 0.036)
    assert found.over_ground_mps == pytest.approx(-20.0, abs=0.05)
    below = (66.0, 0.0, -0.03, -30.0, 10.0, 40.0)
    assert group_detections(detections(below), RADAR, 10.0, 0.0) == []
    assert len(group_detections(detections(below), RADAR, 10.0, 0.0, -0.03)) == 1, "nose up"
