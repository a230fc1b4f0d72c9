"""Traffic of free driving gives no reason to brake: nobody touches the robot or comes near it."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from twin.road.tables.road_tables import road_tables
from twin.scenario.free_driving.classes import CLASSES, RoadClass
from twin.scenario.storyboard.case.files import load_storyboard
from twin.scenario.storyboard.case.way_ahead import nearest_collision_s, road_boxes
from twin.scenario.storyboard.player.columns import Real
from twin.scenario.storyboard.player.storyboard_player import StoryboardPlayer
from twin.world.road_scene import road_map

EVERY = 10
"""Steps between two looks."""


@pytest.mark.parametrize("road_class", CLASSES, ids=lambda road_class: road_class.name)
def test_the_robot_drives_its_way_and_nobody_comes_near(road_class: RoadClass) -> None:
    loaded = load_storyboard(f"driving-{road_class.name}", {})
    program = loaded.program
    half_m = np.array([[e.box.length_m / 2, e.box.width_m / 2] for e in program.entities])
    centre_m = np.array([[e.box.centre_x_m, e.box.centre_y_m] for e in program.entities])
    player = StoryboardPlayer([program], road_tables(road_map(loaded.road).network), 1)
    player.start(0, 0)
    driven_m, steps, nearest_s, gap_m = 0.0, 0, np.inf, np.inf
    while player.running(0):
        player.step()
        steps += 1
        if steps % EVERY:
            continue
        reals = player.bodies.reals.numpy()[0]
        wholes = player.bodies.wholes.numpy()[0]
        nearest_s = min(nearest_s, nearest_collision_s(reals, wholes, half_m, centre_m, 0.2))
        boxes = road_boxes(reals, half_m, centre_m)
        gaps = [
            np.abs(boxes.middle_m[axis][1:] - boxes.middle_m[axis][0])
            - boxes.half_m[axis][1:]
            - boxes.half_m[axis][0]
            for axis in (0, 1)
        ]
        gap_m = min(gap_m, float(np.maximum(*gaps).min()))
        driven_m += float(reals[0, Real.SPEED]) * EVERY * 0.01
    assert driven_m == pytest.approx(road_class.drive_m, abs=8.0)
    assert nearest_s > 6.0
    assert gap_m > 0.4
    low_mps, high_mps = road_class.speed_mps[0][0], road_class.speed_mps[-1][1]
    assert 0.75 * low_mps < driven_m / (steps * 0.01) < high_mps
