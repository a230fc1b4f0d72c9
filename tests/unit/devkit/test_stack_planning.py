"""devkit.planning: the state machine at its exact limits, and the ego's path."""

from __future__ import annotations

import math

import msgspec
import pytest

from devkit.planning import (
    Brake,
    Cruise,
    Hold,
    Plan,
    Planner,
    View,
    is_in_path,
    is_threat,
    lateral_extent_m,
    plan,
)
from schemas.messages import Detection

VIEW = View.from_fov(640, 360, 70.0)
PLANNER = Planner()
THREAT = Detection("car", 0.9, 280.0, 150.0, 80.0, 60.0)

changed = msgspec.structs.replace


def box_of(
    near_m: float,
    right_m: float,
    left_m: float,
    length_m: float = 4.5,
    view: View = VIEW,
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
            u = view.focal_px * (PLANNER.camera_lateral_m - y) / z
            if abs(u) <= half_width:
                us.append(u)
                vs += [view.focal_px * h / z for h in (PLANNER.camera_height_m, -0.1)]
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
    assert is_threat(changed(THREAT, confidence=0.5), VIEW, PLANNER)
    assert not is_threat(changed(THREAT, confidence=math.nextafter(0.5, 0.0)), VIEW, PLANNER)


def test_area_limit_is_inclusive():
    view = View.from_fov(1000, 1000, 70.0)
    planner = Planner(area_min_ratio=0.0048)  # 4800 px^2
    exact = Detection("car", 0.9, 460.0, 480.0, 80.0, 60.0)
    assert is_threat(exact, view, planner)
    assert not is_threat(changed(exact, width_px=math.nextafter(80.0, 0.0)), view, planner)


def test_the_default_area_is_the_originals():
    assert PLANNER.area_min_ratio * 640 * 360 == pytest.approx(1000, rel=0.01)


@pytest.mark.parametrize(
    ("label", "threat"),
    [("car", True), ("truck", True), ("bus", True), ("pedestrian", False), ("bicycle", False)],
)
def test_vehicle_classes(label, threat):
    assert is_threat(changed(THREAT, label=label), VIEW, PLANNER) is threat


# --- the path -----------------------------------------------------------------------------------


def test_lateral_extent_of_a_car_ahead_is_exact():
    right_m, left_m = lateral_extent_m(box_of(12.0, -0.9, 0.9), VIEW, PLANNER)
    assert right_m == pytest.approx(-0.9)
    assert left_m == pytest.approx(0.9)


def test_lateral_extent_of_a_parked_car_uses_its_far_corner():
    planner = changed(PLANNER, flank_length_m=4.5)
    right_m, left_m = lateral_extent_m(box_of(15.0, -4.4, -2.6), VIEW, planner)
    assert right_m == pytest.approx(-4.4)
    assert left_m == pytest.approx(-2.6)


def test_the_camera_sits_right_of_the_centre_line():
    view = View(640, 360, 500.0)
    on_axis = Detection("car", 0.9, 270.0, 150.0, 100.0, 100.0)  # 70 px below the horizon: 10 m
    right_m, left_m = lateral_extent_m(on_axis, view, PLANNER)
    assert (right_m, left_m) == pytest.approx((-1.35, 0.65))


@pytest.mark.parametrize("ends_m", [(-2.4, -1.0), (1.0, 2.4)])
def test_corridor_limit_is_inclusive_on_both_sides(ends_m):
    detection = box_of(15.0, *ends_m)
    inner_m = min(abs(end_m) for end_m in lateral_extent_m(detection, VIEW, PLANNER))
    assert is_in_path(detection, VIEW, changed(PLANNER, corridor_half_m=inner_m))
    assert not is_in_path(
        detection, VIEW, changed(PLANNER, corridor_half_m=math.nextafter(inner_m, 0.0))
    )


@pytest.mark.parametrize("offset_m", [-0.9, -0.45, 0.0, 0.45, 0.9])
def test_car_in_the_lane_is_in_path_at_any_distance_and_overlap(offset_m):
    for near_m in (3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 60.0):
        assert is_in_path(box_of(near_m, offset_m - 0.9, offset_m + 0.9), VIEW, PLANNER)


@pytest.mark.parametrize("size", [(640, 360), (64, 36)])
@pytest.mark.parametrize("length_m", [3.5, 4.5, 5.2])
@pytest.mark.parametrize("ends_m", [(-4.5, -2.65), (2.65, 4.5), (-5.0, -3.0), (3.0, 5.0)])
def test_parked_cars_never_trigger_while_the_ego_passes(size, length_m, ends_m):
    view = View.from_fov(*size, 70.0)
    for decimetre in range(600, -100, -1):
        near_m = decimetre / 10
        try:
            detection = box_of(near_m, *ends_m, length_m, view, whole_pixels=True)
        except ValueError:  # out of sight
            assert near_m < 6.0
            break
        assert not is_threat(detection, view, PLANNER), near_m


def test_a_box_that_ends_at_the_horizon_stands_nowhere():
    at_horizon = Detection("car", 0.9, 300.0, 120.0, 40.0, 60.0)
    assert lateral_extent_m(at_horizon, VIEW, PLANNER) is None
    assert not is_in_path(at_horizon, VIEW, PLANNER)
    assert lateral_extent_m(changed(at_horizon, height_px=60.5), VIEW, PLANNER) is not None


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
    assert plan(Cruise(), [], 3.0, VIEW, PLANNER) == (Cruise(), Plan(speed_mps=8.0, aeb=False))
    assert plan(Cruise(), None, 3.0, VIEW, PLANNER) == (Cruise(), Plan(speed_mps=8.0, aeb=False))


@pytest.mark.parametrize("frames_min", [1, 2, 5])
def test_trigger_on_exactly_n_consecutive_frames(frames_min):
    states = run([True] * frames_min, planner=changed(PLANNER, frames_min=frames_min))
    assert states == [Cruise(n) for n in range(1, frames_min)] + [Brake()]


def test_a_frame_without_threat_starts_the_count_again():
    assert run([True, False, True, True]) == [Cruise(1), Cruise(0), Cruise(1), Brake()]


def test_ticks_without_a_frame_keep_the_count():
    assert run([True, None, None, True]) == [Cruise(1), Cruise(1), Cruise(1), Brake()]
    assert run([None] * 10) == [Cruise(0)] * 10


def test_the_tick_of_the_trigger_already_brakes():
    assert plan(Cruise(1), [THREAT], 8.0, VIEW, PLANNER) == (Brake(), Plan(0.0, aeb=True))


def test_brake_is_latched_and_ends_below_standstill_speed():
    below = math.nextafter(0.05, 0.0)
    states = run([False, None, False, False], [7.0, 1.0, 0.05, below], state=Brake())
    assert states == [Brake(), Brake(), Brake(), Hold()]


def test_hold_stays_for_good():
    assert run([False, True, None], [0.0, 5.0, 8.0], state=Hold()) == [Hold()] * 3
    assert plan(Hold(), [], 0.0, VIEW, PLANNER)[1] == Plan(0.0, aeb=True)
