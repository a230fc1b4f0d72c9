"""Curves that actors follow from their start: where they lead, what arrives along them, what is
refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from native_scenarios import event_elements, mistakes_of, program_of, scenario_text

from twin.scenario.storyboard.compile.curves import end_of
from twin.scenario.storyboard.native.curves import CURVE_PIECES_MAX, curve_trajectory, curve_way
from twin.scenario.storyboard.program.actions import FollowTrajectoryAction, SynchronizeAction
from twin.scenario.storyboard.program.places import FixedPosition

EGO = "{lane: 1, s_m: 100, speed_mps: 10, curve: %s}"
START = FixedPosition(3.0, -2.0, 0.5, 0.5 * math.pi)


def wrong(tmp_path, curve: str) -> list[str]:
    return mistakes_of(tmp_path, scenario_text(ego=EGO % curve, road="track"))


@pytest.mark.parametrize(
    ("curve", "line"),
    [
        ("[]", "ego.curve: given 0 pieces, allowed: 1 to 100; leave curve out to follow the road"),
        ("[[0, 0, 0]]", "ego.curve.0: given a length of 0 m, allowed: from 0.001, and up to 2000"),
        ("[[9, 0, 0], [-3, 0, 0]]", "ego.curve.1: given a length of -3 m, allowed: from 0.001"),
        ("[[1500, 0, 0], [501, 0, 0]]", "ego.curve.1: given a length of 501 m, allowed: from"),
        ("[[9, 0, 0.6]]", "ego.curve.0: given a curvature of 0.6 1/m, allowed: -0.5 to 0.5"),
        ("[[9, -0.51, 0.2]]", "ego.curve.0: given a curvature of -0.51 1/m, allowed: -0.5 to"),
        ("[[9, 0]]", "ego.curve.0: given 2 numbers, needed: length, curvature at the beginning, c"),
        ("[[9, 0, 0, 0]]", "ego.curve.0: given 4 numbers, needed: length, curvature at the"),
        ("[9]", "ego.curve[0]: given 9, expected a list"),
        ("[[.nan, 0, 0]]", "ego.curve[0][0]: given nan, allowed: a number"),
        ("[[9, .inf, 0]]", "ego.curve[0][1]: given inf, allowed: a number"),
        ("[[9, 0, long]]", "ego.curve[0][2]: given 'long', allowed: a number"),
        ("[[9, 0, 0]], turns: [left]", "ego: given curve and turns: give one"),
    ],
)
def test_a_mistake_is_one_line(tmp_path, curve, line):
    lines = wrong(tmp_path, curve)
    assert len(lines) == 1
    assert lines[0].startswith(line), lines


def test_a_curve_has_at_most_so_many_pieces(tmp_path):
    pieces = ", ".join(["[1, 0, 0]"] * CURVE_PIECES_MAX)
    assert wrong(tmp_path, f"[{pieces}]") == []
    assert len(wrong(tmp_path, f"[{pieces}, [1, 0, 0]]")) == 1


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        ("lane: 1, ahead_m: 9, behaviour: idm, speed_mps: 3", "given curve and behaviour"),
        ("lane: 1, ahead_m: 9, heading_deg: 5", "given curve and heading_deg: give one"),
        ("parked: right, ahead_m: 9", "given curve and parked: give one"),
    ],
)
def test_what_leads_elsewhere_is_refused(tmp_path, keys, line):
    text = scenario_text(f"car: {{kind: car, {keys}, curve: [[9, 0, 0]]}}", road="street")
    lines = mistakes_of(tmp_path, text)
    assert len(lines) == 1
    assert lines[0].startswith(f"actors.car: {line}"), lines


def test_a_towed_trailer_has_no_curve(tmp_path):
    text = scenario_text("cart: {kind: trailer, towed_by: ego, curve: [[9, 0, 0]]}")
    (line,) = mistakes_of(tmp_path, text)
    assert line == "actors.cart: curve has no effect beside towed_by: leave it out"


def test_a_path_beside_a_curve_is_refused(tmp_path):
    actor = "walker: {kind: pedestrian, lane: 1, ahead_m: 30, curve: [[9, 0, 0]]}"
    text = scenario_text(actor, "go: {do: {walker: {cross_to: left, speed_mps: 1}}}")
    (line,) = mistakes_of(tmp_path, text)
    assert line.startswith("events.go.do.walker.cross_to: 'walker' follows the curve of its start")


def test_an_arc_is_one():
    radius = 20.0
    trajectory = curve_trajectory("arc", [[0.5 * math.pi * radius, 1 / radius, 1 / radius]], START)
    end = end_of(trajectory.pieces[-1])
    # From heading north to the west, a quarter to the left.
    assert (end.x_m, end.y_m) == pytest.approx((START.x_m - radius, START.y_m + radius), abs=1e-6)
    assert end.heading_rad == pytest.approx(math.pi, abs=1e-6)
    assert end.z_m == START.z_m
    way = curve_way(trajectory, 4)
    assert way.trajectory == 4
    assert way.distance_m[-1] == pytest.approx(0.5 * math.pi * radius)
    away = np.hypot(way.x_m - (START.x_m - radius), way.y_m - START.y_m)
    assert away == pytest.approx(np.full(len(away), radius), abs=1e-5)


def test_pieces_follow_one_another_as_an_integration_by_hand():
    curve = [[5.0, 0.0, 0.0], [8.0, 0.001, 0.1], [6.0, 0.1, 0.1], [8.0, 0.1, -0.2]]
    trajectory = curve_trajectory("turn", curve, START)
    step, x, y, heading = 1e-4, START.x_m, START.y_m, START.heading_rad
    for length, begin, end in curve:
        for index in range(round(length / step)):
            middle = begin + (end - begin) * (index + 0.5) * step / length
            x += step * math.cos(heading + 0.5 * step * middle)
            y += step * math.sin(heading + 0.5 * step * middle)
            heading += step * middle
    last = end_of(trajectory.pieces[-1])
    assert (last.x_m, last.y_m) == pytest.approx((x, y), abs=1e-4)
    assert last.heading_rad == pytest.approx(heading, abs=1e-5)
    starts = [piece.start_s_m for piece in trajectory.pieces]
    assert starts == sorted(starts)
    assert trajectory.pieces[-1].start_s_m + trajectory.pieces[-1].length_m == pytest.approx(27.0)


def test_the_ego_follows_it_from_its_rear_axle(tmp_path):
    program = program_of(tmp_path, scenario_text(ego=EGO % "[[30, 0, 0.1]]", road="track"))
    (follow,) = [
        one.action for one in program.init if isinstance(one.action, FollowTrajectoryAction)
    ]
    assert (follow.trajectory, follow.timed, follow.initial_distance_m) == (0, False, 0.0)
    start = program.entities[0].start
    first = program.trajectories[0].pieces[0]
    assert start is not None
    assert (first.x[0], first.y[0]) == pytest.approx((start.x_m, start.y_m), abs=1e-8)


MEET = """event: {do: {bike: {arrive: {speed_mps: 4, at: {road: "north south", s_m: 12, lane: 1, \
oncoming: true}, %s}}}}"""
BIKE = "bike: {kind: bicycle, road: south, lane: 1, s_m: 230}"
WEST = "{road: west, lane: 1, s_m: 200, speed_mps: 8%s}"


def meeting(tmp_path, meet: str, curve: str = ", curve: [[80, 0, 0], [20, 0, 0.05]]"):
    text = scenario_text(BIKE, MEET % meet, ego=WEST % curve, road="crossroads")
    return text, mistakes_of(tmp_path, text)


def test_somebody_arrives_when_the_ego_is_so_far_along_its_curve(tmp_path):
    text, lines = meeting(tmp_path, "meet_after_m: 55.5")
    assert lines == []
    program = program_of(tmp_path, text)
    index = program.elements.index(event_elements(program)["bike event"])
    (action,) = [one.action for one in program.elements if one.parent == index]
    assert isinstance(action, SynchronizeAction)
    assert (action.master_trajectory, action.master_trajectory_s_m) == (0, 55.5)
    start = program.entities[0].start
    assert start is not None
    assert action.master_position.x_m == pytest.approx(start.x_m + 55.5, abs=1e-6)


@pytest.mark.parametrize(
    ("meet", "curve", "line"),
    [
        ("meet_after_m: 101", None, ".meet_after_m: given 101 m, the curve is 100 m long"),
        ("meet_after_m: 50", "", ".meet_after_m: 'ego' has no curve: give meet_at"),
        (
            "meet_after_m: 50, meet_at: {road: west, s_m: 240}",
            None,
            ": given meet_at and meet_after_m: give one",
        ),
    ],
)
def test_where_the_other_one_cannot_be_is_refused(tmp_path, meet, curve, line):
    more = {} if curve is None else {"curve": curve}
    assert meeting(tmp_path, meet, **more)[1] == [f"events.event.do.bike.arrive{line}"]


def test_places_to_meet_belong_together(tmp_path):
    text = scenario_text(
        BIKE, "event: {do: {bike: {arrive: {meet_after_m: 5}}}}", road="crossroads"
    )
    (line,) = mistakes_of(tmp_path, text.replace("lane: 2, s_m: 100", "lane: 1, s_m: 100"))
    assert line.endswith("arrive: at and meet_after_m belong together: give both or none")
