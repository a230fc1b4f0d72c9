"""The rules ``autodrive``: the published script's limits, its last box, nothing latched."""

from __future__ import annotations

import math

import msgspec
import pytest
from camera_sites import camera_site

from devkit.reference.planning import Brake, Cruise, DrivePlan, Planner, React, plan
from devkit.reference.planning_autodrive import trigger
from devkit.reference.view import CameraView
from schemas.messages import Detection

VIEW = CameraView.of_site(camera_site())
PLANNER = Planner(rules="autodrive", cruise_speed_mps=5.0)
CAR = Detection("car", 0.5, 0.0, 0.0, 40.0, 25.0)

changed = msgspec.structs.replace


def brakes(detections, width_px, height_px):
    return trigger(detections, width_px, height_px) is not None


@pytest.mark.parametrize(
    ("detection", "expected"),
    [
        (CAR, True),
        (changed(CAR, confidence=math.nextafter(0.5, 0)), False),
        (changed(CAR, width_px=39.99), False),  # cut to 39 whole pixels
        (changed(CAR, width_px=40.9, height_px=25.9), True),
        (changed(CAR, width_px=41.9, height_px=24.0), False),  # 41 x 24
        (changed(CAR, width_px=24.0, height_px=41.9), False),
        (changed(CAR, label="truck"), False),
    ],
)
def test_limits(detection, expected):
    assert brakes([detection], 640, 360) is expected


def test_the_size_is_that_in_the_scripts_image():
    assert brakes([changed(CAR, width_px=80.0, height_px=50.0)], 1280, 720)
    assert not brakes([changed(CAR, width_px=79.9, height_px=50.0)], 1280, 720)
    assert brakes([changed(CAR, width_px=20.0, height_px=12.5)], 320, 180)


def test_the_last_confident_box_decides_alone():
    person = Detection("person", 0.9, 0.0, 0.0, 90.0, 90.0)
    faint = changed(person, confidence=0.49)
    assert not brakes([], 640, 360)
    assert brakes([person, CAR], 640, 360)
    assert not brakes([CAR, person], 640, 360)
    assert brakes([CAR, faint], 640, 360)
    assert not brakes([CAR, changed(CAR, width_px=10.0)], 640, 360)
    assert trigger([person, faint, CAR, faint], 640, 360) == 2


def test_every_frame_decides_anew_and_ticks_between_frames_keep_it():
    state, seen = Cruise(), []
    for detections in (None, [], [CAR], None, None, [], None, [CAR]):
        state, asked = plan(state, detections, 0.0, VIEW, PLANNER)
        seen.append(asked.aeb)
    assert seen == [False, False, True, True, True, False, False, True]
    assert isinstance(state, React)
    assert asked == DrivePlan(0.0, aeb=True, trigger=0)
    assert plan(state, [], 0.0, VIEW, PLANNER) == (React(), DrivePlan(5.0, aeb=False))


def test_the_default_rules_need_two_frames_and_latch():
    both = [CAR, changed(CAR, x_px=300.0, y_px=200.0, width_px=60.0, height_px=60.0)]
    state, asked = plan(Cruise(), both, 5.0, VIEW, Planner())
    assert not asked.aeb
    state, asked = plan(state, both, 5.0, VIEW, Planner())
    assert (state, asked.aeb) == (Brake(), True)
    assert plan(state, [], 5.0, VIEW, Planner())[1].aeb


@pytest.mark.parametrize(
    "limits", [{"ttc_max_s": 2.0}, {"confidence_min": 0.4}, {"area_min_ratio": 0.1}]
)
def test_limits_that_would_have_no_effect_are_refused(limits):
    with pytest.raises(ValueError, match=f"{next(iter(limits))} is set, but rules: autodrive"):
        Planner(rules="autodrive", **limits)
    Planner(**limits)
