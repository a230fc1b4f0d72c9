"""devkit.reference.planning: the state machine at its exact limits, and the ego's path."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import pytest
from camera_sites import camera_site

from devkit.reference.planning import (
    SHAPES,
    Brake,
    Cruise,
    DrivePlan,
    Hold,
    Planner,
    extent_m,
    is_relevant,
    nearest,
    plan,
)
from devkit.reference.view import CameraView
from schemas.messages import Detection


def view_of(width: int = 640, height: int = 360, **changes: Any) -> CameraView:
    return CameraView.of_site(camera_site(width, height, **changes))


VIEW = view_of()
PLANNER = Planner()
THREAT = Detection("car", 0.9, 280.0, 150.0, 80.0, 60.0)
"""At 20 m: 2.5 s away at 8 m/s."""

changed = msgspec.structs.replace


def nearest_m(detections: list[Detection], *args: Any) -> float:
    """Distance of the nearest relevant object in the path; infinite: there is none [m]."""
    found = nearest(detections, *args)
    return found.ahead_m if found else math.inf


def box_of(
    near_m: float,
    right_m: float,
    left_m: float,
    length_m: float = 4.5,
    view: CameraView = VIEW,
    whole_pixels: bool = False,
) -> Detection:
    """The box of a car, a cuboid 1.5 m high; lateral ends in the ego's frame, left positive.

    Clipped by the image, and by the nearest point whose ground the image shows.
    """
    half_width, half_height = 0.5 * view.width_px, 0.5 * view.height_px
    us, vs = [], []
    steps = 400
    for i in range(steps + 1):
        z = near_m + length_m * i / steps
        if z <= 0.1:
            continue
        for y in (right_m, left_m):
            u = view.lens.fx_px * (view.lateral_m - y) / z
            if abs(u) <= half_width:
                us.append(u)
                vs += [view.lens.fx_px * h / z for h in (view.above_m, -0.1)]
    left, right = min(us) + half_width, max(us) + half_width
    top, bottom = min(vs) + half_height, min(max(vs), half_height) + half_height
    if whole_pixels:
        left, top, right, bottom = (
            math.floor(left),
            math.floor(top),
            math.ceil(right),
            math.ceil(bottom),
        )
    return Detection("car", 0.9, left, top, right - left, bottom - top)


# --- one detection ------------------------------------------------------------------------------


def test_confidence_limit_is_inclusive():
    assert is_relevant(changed(THREAT, confidence=0.5), VIEW, PLANNER)
    assert not is_relevant(changed(THREAT, confidence=math.nextafter(0.5, 0.0)), VIEW, PLANNER)


def test_area_limit_is_inclusive():
    view = view_of(1000, 1000)
    planner = Planner(area_min_ratio=0.0048)  # 4800 px^2
    exact = Detection("car", 0.9, 460.0, 480.0, 80.0, 60.0)
    assert is_relevant(exact, view, planner)
    assert not is_relevant(changed(exact, width_px=math.nextafter(80.0, 0.0)), view, planner)


@pytest.mark.parametrize("label", SHAPES)
def test_the_area_limit_is_one_of_distance_for_every_label(label):
    width_m, height_m, _ = SHAPES[label]
    relevant = []
    for ahead_m in (25.0, 34.0, 36.0, 50.0):
        scale = VIEW.lens.fx_px / ahead_m
        box = Detection(label, 0.9, 300.0, 150.0, width_m * scale, height_m * scale)
        relevant.append(is_relevant(box, VIEW, PLANNER))
    assert relevant == [True, True, False, False]


@pytest.mark.parametrize(("label", "relevant"), [("bus", True), ("traffic_sign", False)])
def test_labels(label, relevant):
    large = changed(THREAT, label=label, width_px=200.0, height_px=150.0)
    assert is_relevant(large, VIEW, PLANNER) is relevant
    assert (extent_m(large, VIEW) is not None) is relevant


# --- where it stands ----------------------------------------------------------------------------


def test_the_extent_of_a_car_ahead_is_exact():
    assert extent_m(box_of(12.0, -0.9, 0.9), VIEW) == pytest.approx((12.0, -0.9, 0.9))


def test_the_extent_of_a_parked_car_uses_its_far_corner():
    right, left = -4.4, -2.6
    car = box_of(15.0, right, left, length_m=SHAPES["car"].flank_m)
    assert extent_m(car, VIEW) == pytest.approx((15.0, right, left))


def test_a_longer_road_user_is_granted_a_longer_flank():
    inner = [
        extent_m(changed(box_of(15.0, 2.3, 4.8, 12.0), label=label), VIEW).right_m
        for label in ("bus", "truck", "car", "pedestrian")
    ]
    assert inner == sorted(inner, reverse=True)
    assert 1.9 < inner[0] < 2.3


def test_the_camera_sits_where_the_episode_says():
    box = Detection("car", 0.9, 270.0, 150.0, 100.0, 100.0)  # 70 px below the horizon, on the axis
    view = view_of(position_m=(2.0, -0.5, 1.4))
    ahead_m = view.lens.fx_px * 1.4 / 70.0
    half_m = 50.0 / view.lens.fx_px * ahead_m
    assert extent_m(box, view) == pytest.approx((ahead_m, -0.5 - half_m, -0.5 + half_m))


@pytest.mark.parametrize(
    ("rotation_deg", "shift_px"),
    [((0.0, 5.0, 0.0), (0.0, 1.0)), ((0.0, 0.0, 8.0), (1.0, 0.0))],
)
def test_a_turned_camera_sees_the_same_place_elsewhere(rotation_deg, shift_px):
    turned = view_of(rotation_deg=rotation_deg)
    angle = math.radians(max(rotation_deg))
    down = VIEW.lens.fx_px * 1.32 / 12.0
    if shift_px[1]:  # looking down: the ground moves up in the image
        level = math.atan(down / VIEW.lens.fx_px)
        y = 180.0 + VIEW.lens.fx_px * math.tan(level - angle)
        assert turned.ground_m(320.0, y) == pytest.approx(12.0)
        assert turned.across_m(320.0, y, 12.0) == pytest.approx(-0.35)
    else:  # looking left: straight ahead is right of the middle
        x = 320.0 + VIEW.lens.fx_px * math.tan(angle)
        y = 180.0 + down / math.cos(angle)
        assert turned.ground_m(x, y) == pytest.approx(12.0)
        assert turned.across_m(x, y, 12.0) == pytest.approx(-0.35)


@pytest.mark.parametrize("ends_m", [(-2.4, -1.0), (1.0, 2.4)])
def test_the_corridor_is_inclusive_on_both_sides(ends_m):
    detection = box_of(15.0, *ends_m)
    extent = extent_m(detection, VIEW)
    inner_m = min(abs(extent.right_m), abs(extent.left_m))
    wide, narrow = (
        changed(PLANNER, corridor_half_m=half) for half in (inner_m, math.nextafter(inner_m, 0.0))
    )
    assert nearest_m([detection], VIEW, wide) == extent.ahead_m
    assert nearest_m([detection], VIEW, narrow) == math.inf


@pytest.mark.parametrize("offset_m", [-0.9, -0.45, 0.0, 0.45, 0.9])
def test_a_car_in_the_lane_is_in_the_path_at_any_distance_and_overlap(offset_m):
    for ahead_m in (3.0, 5.0, 8.0, 12.0, 20.0, 30.0):
        car = box_of(ahead_m, offset_m - 0.9, offset_m + 0.9)
        assert nearest_m([car], VIEW, PLANNER) < ahead_m * 1.01 + 0.5


@pytest.mark.parametrize("size", [(640, 360), (64, 36)])
@pytest.mark.parametrize("length_m", [3.5, 4.5, 5.2])
@pytest.mark.parametrize("ends_m", [(-4.5, -2.65), (2.65, 4.5), (-5.0, -3.0), (3.0, 5.0)])
def test_parked_cars_never_trigger_while_the_ego_passes(size, length_m, ends_m):
    view = view_of(*size)
    for decimetre in range(600, -100, -1):
        near_m = decimetre / 10
        try:
            detection = box_of(near_m, *ends_m, length_m, view, whole_pixels=True)
        except ValueError:  # out of sight
            assert near_m < 6.0
            break
        assert nearest_m([detection], view, PLANNER) > PLANNER.ttc_max_s * 8.0, near_m


def test_the_path_bends_with_the_ego():
    """A car parked 3.5 m right of a path that bends left with 40 m radius is straight ahead."""
    radius_m, ahead_m = 40.0, 17.0
    bend_m = (VIEW.forward_m + ahead_m) ** 2 / (2 * radius_m)
    car = box_of(ahead_m, bend_m - 4.4, bend_m - 2.6)
    assert nearest_m([car], VIEW, PLANNER) < math.inf
    assert nearest_m([car], VIEW, PLANNER, 1.0 / radius_m) == math.inf
    ahead = box_of(ahead_m, bend_m - 0.9, bend_m + 0.9)
    assert nearest_m([ahead], VIEW, PLANNER) == math.inf
    assert nearest_m([ahead], VIEW, PLANNER, 1.0 / radius_m) == pytest.approx(ahead_m)


def test_the_nearest_counts_in_any_order():
    cars = [box_of(d, -0.9, 0.9) for d in (22.0, 9.0, 15.0)]
    assert nearest_m(cars, VIEW, PLANNER) == nearest_m(cars[::-1], VIEW, PLANNER)
    assert nearest_m(cars, VIEW, PLANNER) == pytest.approx(9.0)
    assert nearest_m([], VIEW, PLANNER) == math.inf


def test_a_box_that_ends_at_the_horizon_stands_nowhere():
    at_horizon = Detection("car", 0.9, 300.0, 120.0, 40.0, 60.0)
    assert extent_m(at_horizon, VIEW) is None
    assert nearest_m([at_horizon], VIEW, PLANNER) == math.inf
    assert extent_m(changed(at_horizon, height_px=60.5), VIEW) is not None


def test_behind_the_camera_a_ray_leads_to_its_side():
    """A wide camera that looks 80 degrees to the left: half of its image lies behind the ego."""
    view = view_of(hfov_deg=150.0, rotation_deg=(0.0, 0.0, 80.0))
    assert view.ray(0.0, 300.0)[0] < 0.0
    assert view.across_m(0.0, 300.0, 5.0) == math.inf
    assert view.ground_m(0.0, 300.0) is None
    other = view_of(hfov_deg=150.0, rotation_deg=(0.0, 0.0, -80.0))
    assert other.across_m(640.0, 300.0, 5.0) == -math.inf
    assert math.isfinite(other.across_m(0.0, 300.0, 5.0))


@pytest.mark.parametrize("yaw_deg", [20.0, -20.0])
def test_a_car_that_fills_a_wide_turned_camera_is_in_the_path(yaw_deg):
    """One end of its box is a ray to the back: without end to that side, not on the other one."""
    view = view_of(hfov_deg=150.0, rotation_deg=(0.0, 0.0, yaw_deg))
    filling = Detection("car", 0.9, 0.0, 0.0, 640.0, 360.0)
    ends = [view.ray(x_px, 360.0)[0] for x_px in (0.0, 640.0)]
    assert min(ends) < 0.0 < max(ends)
    assert 0.0 < nearest_m([filling], view, PLANNER) < 5.0


# --- the state machine --------------------------------------------------------------------------


def run(frames, speeds=None, planner=PLANNER, state=None):
    """States after each tick; frames are True (threat), False (nothing) or None (no frame)."""
    state = state or Cruise()
    states = []
    for index, frame in enumerate(frames):
        detections = None if frame is None else [THREAT] * frame
        state, _ = plan(state, detections, speeds[index] if speeds else 8.0, VIEW, planner)
        states.append(state)
    return states


def test_cruise_on_a_free_road():
    free = DrivePlan(speed_mps=8.0, aeb=False)
    assert plan(Cruise(), [], 3.0, VIEW, PLANNER) == (Cruise((False,)), free)
    assert plan(Cruise(), None, 3.0, VIEW, PLANNER) == (Cruise(), free)


def test_the_time_to_collision_is_inclusive():
    car = box_of(16.0, -0.9, 0.9)
    ahead_m = extent_m(car, VIEW).ahead_m
    planner = changed(PLANNER, ttc_max_s=2.0, frames_min=1)
    exact = ahead_m / 2.0
    assert plan(Cruise(), [car], exact, VIEW, planner)[0] == Brake()
    assert plan(Cruise(), [car], exact * (1 - 1e-9), VIEW, planner)[0] == Cruise((False,))


def test_a_standing_ego_has_time():
    assert run([True] * 5, [0.0] * 5)[-1] == Cruise((False,) * 3)


@pytest.mark.parametrize("frames_min", [1, 2, 5])
def test_trigger_on_exactly_n_frames(frames_min):
    planner = changed(PLANNER, frames_min=frames_min, frames_window=5)
    states = run([True] * frames_min, planner=planner)
    assert states == [Cruise((True,) * n) for n in range(1, frames_min)] + [Brake()]


def test_a_missed_frame_does_not_start_the_count_again():
    assert run([True, False, True])[-1] == Brake()
    assert run([True, False, False, True])[-1] == Cruise((False, False, True))


def test_a_flash_does_not_brake():
    assert Brake() not in run([True, False, False] * 20)


def test_ticks_without_a_frame_keep_what_was_seen():
    assert run([True, None, None, True]) == [Cruise((True,))] * 3 + [Brake()]
    assert run([None] * 10) == [Cruise()] * 10


def test_a_window_smaller_than_the_count_is_refused():
    with pytest.raises(ValueError, match="frames_window: given 2, allowed: at least frames_min 3"):
        Planner(frames_min=3, frames_window=2)


def test_the_tick_of_the_trigger_already_brakes():
    braking = DrivePlan(0.0, aeb=True, trigger=0)
    assert plan(Cruise((True,)), [THREAT], 8.0, VIEW, PLANNER) == (Brake(), braking)


def test_it_warns_from_the_warning_time_on_and_no_later_than_the_first_threat():
    far = box_of(40.0, -0.9, 0.9)  # 5 s away at 8 m/s
    for warning_ttc_s, expected in ((0.0, False), (4.9, False), (5.1, True)):
        planner = Planner(warning_ttc_s=warning_ttc_s, area_min_ratio=0.0)
        state, drive = plan(Cruise(), [far], 8.0, VIEW, planner)
        assert (drive.warning, drive.aeb) == (expected, False)
        state, drive = plan(state, None, 8.0, VIEW, planner)
        assert drive.warning == expected, "kept until the next frame"
        assert not plan(state, [], 8.0, VIEW, planner)[1].warning
    assert plan(Cruise(), [THREAT], 8.0, VIEW, PLANNER)[1].warning
    assert plan(Brake(), [], 8.0, VIEW, PLANNER)[1].warning


def test_the_trigger_is_the_nearest_object_in_the_path_and_told_once():
    parked, far = box_of(9.0, -5.0, -3.0), box_of(22.0, -0.9, 0.9)
    faint = changed(THREAT, confidence=0.1)
    seen = [parked, faint, far, THREAT]
    state, first = plan(Cruise(), seen, 8.0, VIEW, PLANNER)
    assert first == DrivePlan(8.0, aeb=False, warns=True)
    state, second = plan(state, seen, 8.0, VIEW, PLANNER)
    assert second == DrivePlan(0.0, aeb=True, trigger=3)
    assert plan(state, seen, 8.0, VIEW, PLANNER)[1] == DrivePlan(0.0, aeb=True), (
        "latched, not triggered"
    )


def test_brake_is_latched_and_ends_below_standstill_speed():
    below = math.nextafter(0.05, 0.0)
    states = run([False, None, False, False], [7.0, 1.0, 0.05, below], state=Brake())
    assert states == [Brake(), Brake(), Brake(), Hold()]


def test_hold_stays_for_good():
    assert run([False, True, None], [0.0, 5.0, 8.0], state=Hold()) == [Hold()] * 3
    assert plan(Hold(), [], 0.0, VIEW, PLANNER)[1] == DrivePlan(0.0, aeb=True)
