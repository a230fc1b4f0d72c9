"""When a robot lets go, and the pose that it commands."""

from __future__ import annotations

import math

import pytest

from twin.scenario.driver import BRAKED, STEERED, LedPose, RobotLimits

LIMITS = RobotLimits(brake=0.05, steering_rad=0.1)


@pytest.mark.parametrize(
    ("brake", "handbrake", "steering_rad", "path_rad", "kind"),
    [
        (0.0499, 0.0499, 0.0, 0.0, 0),
        (0.05, 0.0, 0.0, 0.0, BRAKED),
        (0.0, 0.05, 0.0, 0.0, BRAKED),
        (1.0, 0.0, 0.6, 0.0, BRAKED),
        (0.0, 0.0, 0.0999, 0.0, 0),
        (0.0, 0.0, -0.0999, 0.0, 0),
        (0.0, 0.0, 0.1, 0.0, STEERED),
        (0.0, 0.0, -0.1, 0.0, STEERED),
        # On a path to the left: straight ahead, along it, and beyond either.
        (0.0, 0.0, 0.0, 0.3, 0),
        (0.0, 0.0, 0.39, 0.3, 0),
        (0.0, 0.0, 0.41, 0.3, STEERED),
        (0.0, 0.0, -0.11, 0.3, STEERED),
        (0.0, 0.0, -0.41, -0.3, STEERED),
        (0.0, 0.0, 0.11, -0.3, STEERED),
        (0.0, 0.0, -0.2, -0.3, 0),
        (0.0, 0.0, 0.6, None, 0),
        (0.1, 0.0, 0.6, None, BRAKED),
    ],
)
def test_commands_from_the_limits_on_intervene(brake, handbrake, steering_rad, path_rad, kind):
    assert LIMITS.exceeded(brake, handbrake, steering_rad, path_rad) == kind


def test_the_pose_turns_about_z_then_y_then_x():
    pose = LedPose(1.0, 2.0, 3.0, math.radians(90), math.radians(30), math.radians(10), 5.0).pose
    assert (pose.x_m, pose.y_m, pose.z_m) == (1.0, 2.0, 3.0)
    x, y, z, w = pose.qx, pose.qy, pose.qz, pose.qw
    forward = (1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w))
    assert forward == pytest.approx((0.0, math.cos(math.radians(30)), -0.5), abs=1e-12)
    left_up = 2 * (y * z + x * w)
    assert left_up == pytest.approx(math.sin(math.radians(10)) * math.cos(math.radians(30)))
