"""Recorded poses: where everybody is at their times, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from native_scenarios import mistakes_of, program_of, scenario_text

from twin.road.tables.road_tables import road_tables
from twin.scenario.storyboard.native.bodies import BODIES
from twin.scenario.storyboard.player.storyboard_player import StoryboardPlayer

EGO = "{poses: [[0, 100, -5.4, 0], [1, 110, -5.4, 0], [2.5, 130, -5.0, 3]]}"
VAN = "van: {kind: van, poses: [[0, 140, -1.8, 170], [0.5, 140, -1.8, 190], [2, 131, -3, 190]]}"


def wrong(tmp_path, poses: str, more: str = "") -> list[str]:
    actor = f"a: {{kind: car, poses: {poses}{more}}}"
    return mistakes_of(tmp_path, scenario_text(actor))


@pytest.mark.parametrize(
    ("poses", "line"),
    [
        ("[]", "actors.a.poses: given 0 poses, at least 2 needed"),
        ("[[0, 1, 2, 3]]", "actors.a.poses: given 1 poses, at least 2 needed"),
        ("[[0, 1, 2, 3], [1, 2, 3]]", "actors.a.poses.1: given 3 numbers, needed: time [s], x, y"),
        ("[[0, 1, 2, 3], [0, 2, 3, 4]]", "actors.a.poses.1: time 0 s, times must rise from 0 on"),
        ("[[-1, 1, 2, 3], [0, 2, 3, 4]]", "actors.a.poses.0: time -1 s, times must rise from 0"),
        ("[[0, 1, 2, 3], [1e9, 2, 3, 4]]", "actors.a.poses.1: a time of 1e+09, allowed: up to 86"),
        ("[[0, 1e6, 2, 3], [1, 2, 3, 4]]", "actors.a.poses.0: x of 1e+06, allowed: up to 100000"),
        ("[[0, 1, 2, 3], [1, 2, -1e6, 4]]", "actors.a.poses.1: y of -1e+06, allowed: up to 1000"),
        ("[[0, 1, 2, .nan], [1, 2, 3, 4]]", "actors.a.poses[0][3]: given nan, allowed: a number"),
    ],
)
def test_a_mistake_is_one_line(tmp_path, poses, line):
    (told,) = wrong(tmp_path, poses)
    assert told.startswith(line), told


@pytest.mark.parametrize(
    "more", [", lane: 1", ", s_m: 5", ", heading_deg: 5", ", turns: [left]", ", behaviour: idm"]
)
def test_nothing_else_says_where_it_is(tmp_path, more):
    (told,) = wrong(tmp_path, "[[0, 100, 0, 0], [1, 101, 0, 0]]", more)
    assert "has no effect beside poses: leave it out" in told


def test_ego_needs_a_lane_or_poses(tmp_path):
    (told,) = mistakes_of(tmp_path, scenario_text(ego="{speed_mps: 3}"))
    assert "needed: lane and s_m, or the poses of a recorded drive" in told


def test_everybody_is_where_the_poses_say(tmp_path):
    program = program_of(tmp_path, scenario_text(VAN, ego=EGO, end="{after_s: 2.5}"))
    assert program.network is not None
    player = StoryboardPlayer([program], road_tables(program.network), slots=1)
    player.start(0, 0)
    ego = np.array([[0, 100, -5.4, 0], [1, 110, -5.4, 0], [2.5, 130, -5.0, 3]])
    van = np.array([[0, 140, -1.8, 170], [0.5, 140, -1.8, 190], [2, 131, -3, 190]])
    step = 0
    while player.running(0):
        player.step()
        step += 1
        states, time_s = player.states(), 0.01 * step
        assert _of(states, 0) == pytest.approx(_at(ego, time_s), abs=1e-6), time_s
        if 0.5 < time_s <= 2.0:  # it turns on the spot before
            x, y, heading = _of(states, 1)
            ahead = BODIES["van"].centre_x_m
            middle = x + ahead * math.cos(heading), y + ahead * math.sin(heading), heading
            assert middle == pytest.approx(_at(van, time_s), abs=1e-6), time_s
    assert step >= 250  # the end is seen a step later


def _of(states, entity: int) -> tuple[float, float, float]:
    heading = float(states.heading_rad[0, entity])
    return float(states.x_m[0, entity]), float(states.y_m[0, entity]), heading % (2.0 * math.pi)


def _at(poses: np.ndarray, time_s: float) -> tuple[float, float, float]:
    x, y, heading = (float(np.interp(time_s, poses[:, 0], poses[:, c])) for c in (1, 2, 3))
    return x, y, math.radians(heading) % (2.0 * math.pi)


def test_height_is_that_of_the_road(tmp_path):
    text = scenario_text(ego="{poses: [[0, 250, 95, 80], [1, 250, 99, 80]]}", road="rural")
    beside = scenario_text(ego="{poses: [[0, 9000, 9000, 0], [1, 9001, 9000, 0]]}", road="rural")
    start = program_of(tmp_path, beside).entities[0].start
    assert start is not None
    assert (start.road, start.z_m) == (-1, 0.0)
    assert mistakes_of(tmp_path, text) == []
