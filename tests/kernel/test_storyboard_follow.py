"""Trajectories, synchronisation and imposed bodies, on open ground."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from storyboard_programs import (
    STEP_S,
    EventPlan,
    GroupPlan,
    at,
    car,
    from_time,
    played,
    program,
    speed_at_once,
    start_at,
    steps_of,
)

from twin.scenario.storyboard.player.storyboard_player import StoryboardPlayer
from twin.scenario.storyboard.program.actions import (
    FinalSpeedKind,
    FollowTrajectoryAction,
    SteadyStateKind,
    SynchronizeAction,
)
from twin.scenario.storyboard.program.places import Trajectory, TrajectoryPiece

pytestmark = pytest.mark.slow

BEGIN = 20


def line(points, times=None, *, closed=False, from_actor=False):
    """A polyline."""
    pieces, s = [], 0.0
    for index, ((x0, y0), (x1, y1)) in enumerate(pairwise(points)):
        length = math.hypot(x1 - x0, y1 - y0)
        heading = math.atan2(y1 - y0, x1 - x0)
        begin, span = (times[index], times[index + 1] - times[index]) if times else (0.0, 0.0)
        x = (x0, math.cos(heading), 0.0, 0.0)
        y = (y0, math.sin(heading), 0.0, 0.0)
        flat = (0.0,) * 4
        pieces.append(TrajectoryPiece(s, length, x, y, flat, (heading, 0.0, 0.0, 0.0), begin, span))
        s += length
    return Trajectory("t", closed, times is not None, tuple(pieces), from_actor)


def follow(trajectory, steps=600, *, speed_mps=10.0, timed=False, place=None, **changes):
    fields = {"absolute_time": False, "time_scale": 1.0, "time_offset_s": 0.0}
    fields |= {"follow": True, "initial_distance_m": 0.0} | changes
    action = FollowTrajectoryAction(trajectory=0, timed=timed, **fields)
    plan = program(
        [car()],
        start_at(0, place or at(-5.0, 3.0), speed_mps),
        [GroupPlan((0,), [EventPlan(from_time(BEGIN * STEP_S), [action])])],
        trajectories=[trajectory],
    )
    return played(plan, steps)


def along(points, way):
    """Places of a polyline at distances from its beginning."""
    points = np.array(points)
    ends = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    return np.interp(way, ends, points[:, 0]), np.interp(way, ends, points[:, 1])


CORNER = [(0.0, 0.0), (10.0, 0.0), (10.0, 20.0)]


@pytest.mark.parametrize("begin_m", [0.0, 4.0])
def test_by_speed(begin_m):
    """Along the line with the body's speed; what is left of the last step goes straight on."""
    done = follow(line(CORNER), 400, initial_distance_m=begin_m)
    last = BEGIN + math.ceil((30.0 - begin_m) / 0.1 - 1e-9)
    way = begin_m + np.arange(last - BEGIN + 1) * 0.1
    x, y = along(CORNER, way[1:])
    np.testing.assert_allclose(done.x_m[BEGIN + 1 : last + 1, 0], x, atol=1e-9)
    np.testing.assert_allclose(done.y_m[BEGIN + 1 : last + 1, 0], y, atol=1e-9)
    assert done.heading_rad[BEGIN + 50, 0] == pytest.approx(
        0.0 if begin_m + 5 < 10 else math.pi / 2
    )
    assert steps_of(done.events, "g0.e0", "end") == [last - 1]
    assert done.y_m[last + 10, 0] == pytest.approx(21.0, abs=1e-6)


def test_backwards():
    """A body that drives backwards is turned round and goes along the line all the same."""
    done = follow(line(CORNER), 60, speed_mps=-10.0)
    assert done.x_m[BEGIN + 10, 0] == pytest.approx(1.0)
    assert abs(done.heading_rad[BEGIN + 10, 0]) == pytest.approx(math.pi)
    assert done.speed_mps[-1, 0] == -10.0


def test_closed_goes_round():
    square = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0), (0.0, 0.0)]
    done = follow(line(square, closed=True), BEGIN + 500)
    assert steps_of(done.events, "g0.e0", "end") == []
    x, y = along(square, 50.0 - 40.0)
    assert (done.x_m[-1, 0], done.y_m[-1, 0]) == pytest.approx((x, y), abs=1e-9)


@pytest.mark.parametrize("absolute", [False, True])
@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (0.5, 0.0), (2.0, 0.25)])
def test_by_times(absolute, scale, offset):
    times = [0.0, 1.0, 2.0]
    done = follow(
        line(CORNER, times),
        700,
        timed=True,
        absolute_time=absolute,
        time_scale=scale,
        time_offset_s=offset,
    )
    begin = 0.0 if absolute else BEGIN * STEP_S
    rows = np.arange(BEGIN + 1, len(done.x_m))
    own = (rows * STEP_S - begin - offset) / scale
    way = np.interp(own, times, [0.0, 10.0, 30.0])
    on = own < 2.0 - 1e-9
    x, y = along(CORNER, way[on])
    np.testing.assert_allclose(done.x_m[rows[on], 0], x, atol=1e-7)
    np.testing.assert_allclose(done.y_m[rows[on], 0], y, atol=1e-7)
    ended = steps_of(done.events, "g0.e0", "end")[0]
    assert ended == rows[np.argmax(own >= 2.0 - 1e-6)] - 1
    assert done.speed_mps[-1, 0] == pytest.approx(20.0 / scale, rel=0.02)
    beyond = (len(done.y_m) - 1) * STEP_S - begin - offset - 2.0 * scale
    assert done.y_m[-1, 0] == pytest.approx(20.0 + beyond * 20.0 / scale, rel=0.02)


def test_in_the_axes_of_the_actor():
    done = follow(line(CORNER, from_actor=True), 60, place=at(5.0, 7.0, math.pi / 2))
    x0, y0 = done.x_m[BEGIN, 0], done.y_m[BEGIN, 0]
    assert done.x_m[BEGIN + 30, 0] == pytest.approx(x0)
    assert done.y_m[BEGIN + 30, 0] == pytest.approx(y0 + 3.0)
    assert done.heading_rad[BEGIN + 30, 0] == pytest.approx(math.pi / 2)


def synchronise(final, speed_mps, steady=SteadyStateKind.NONE, value=0.0, tolerance_m=0.0):
    action = SynchronizeAction(
        *(1, at(200.0, 10.0), at(100.0), final, speed_mps, steady, value, 0.0, tolerance_m)
    )
    plan = program(
        [car("actor"), car("master")],
        [*start_at(0, at(0.0), 10.0), *start_at(1, at(0.0, 10.0), 20.0)],
        [GroupPlan((0,), [EventPlan(from_time(BEGIN * STEP_S), [action])])],
    )
    return played(plan, 1200)


@pytest.mark.parametrize("speed_mps", [2.0, 10.0, 15.0, 30.0])
def test_both_arrive_together(speed_mps):
    done = synchronise(FinalSpeedKind.ABSOLUTE, speed_mps)
    ended = steps_of(done.events, "g0.e0", "end")[0]
    assert ended * STEP_S == pytest.approx(10.0, abs=0.02)
    assert done.x_m[ended, 0] == pytest.approx(100.0, abs=0.35)
    assert done.speed_mps[-1, 0] == speed_mps
    assert np.abs(np.diff(done.speed_mps[BEGIN:ended, 0])).max() < 0.2


def test_arrival_without_a_final_speed():
    done = synchronise(FinalSpeedKind.NONE, 0.0)
    ended = steps_of(done.events, "g0.e0", "end")[0]
    assert done.x_m[ended, 0] == pytest.approx(100.0, abs=0.2)


def test_arrival_relative_to_the_master():
    done = synchronise(FinalSpeedKind.RELATIVE_TO_MASTER, -5.0)
    assert done.speed_mps[-1, 0] == 15.0


@pytest.mark.parametrize(
    ("kind", "value"), [(SteadyStateKind.DISTANCE, 30.0), (SteadyStateKind.TIME, 2.0)]
)
def test_steady_state_before_the_arrival(kind, value):
    done = synchronise(FinalSpeedKind.ABSOLUTE, 15.0, kind, value)
    ended = steps_of(done.events, "g0.e0", "end")[0]
    assert done.x_m[ended, 0] == pytest.approx(100.0, abs=0.35)
    assert (done.speed_mps[ended - 190 : ended, 0] == 15.0).all()
    assert done.speed_mps[ended - 230, 0] != 15.0


def test_imposed_bodies_stay_where_they_are_put():
    plan = program(
        [car("ego"), car("b")], [*start_at(0, at(0.0), 10.0), *start_at(1, at(9.0), 5.0)]
    )
    player = StoryboardPlayer([plan], None, 1, step_s=STEP_S)
    player.start(0, 0)
    for step in range(50):
        player.impose(0, 0, 1.0 + step, -4.0, 0.5, 0.3, 0.01, 0.02, 7.0)
        player.step()
    states = player.states()
    assert states.x_m[0].tolist() == pytest.approx([50.0, 11.5])
    assert states.y_m[0, 0] == -4.0
    assert (states.z_m[0, 0], states.pitch_rad[0, 0], states.roll_rad[0, 0]) == (0.5, 0.01, 0.02)
    assert states.speed_mps[0].tolist() == [7.0, 5.0]


def test_speed_actions_of_imposed_bodies_end_at_once():
    events = [EventPlan(from_time(0.1), [speed_at_once(3.0)])]
    plan = program([car("ego")], start_at(0, at(0.0), 10.0), [GroupPlan((0,), events)])
    player = StoryboardPlayer([plan], None, 1, step_s=STEP_S)
    player.start(0, 0)
    player.impose(0, 0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 7.0)
    for _ in range(20):
        player.step()
    assert player.states().speed_mps[0, 0] == 7.0
    assert [t.step for t in player.transitions(0)][-1] == 10
