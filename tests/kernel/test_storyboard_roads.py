"""Actions and the default controller on roads: lane changes, offsets, distances, routes."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import LINE, geometry, lane, road, section, xodr
from road_networks import junction
from storyboard_programs import (
    STEP_S,
    EventPlan,
    GroupPlan,
    car,
    dynamics,
    from_time,
    played,
    program,
    speed_at_once,
    start_at,
    steps_of,
    trigger,
    when,
)

from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.road_map import RoadMap
from twin.road.tables.road_tables import road_tables
from twin.scenario.storyboard.program.actions import (
    AcquirePositionAction,
    AssignRouteAction,
    Displacement,
    DynamicsDimension,
    DynamicsShape,
    LaneChangeAction,
    LaneOffsetAction,
    LateralDistanceAction,
    LongitudinalDistanceAction,
    MotionLimits,
    TeleportAction,
)
from twin.scenario.storyboard.program.conditions import (
    DistanceFrame,
    EndOfRoadCondition,
    OffroadCondition,
)
from twin.scenario.storyboard.program.places import (
    FixedPosition,
    RelativeFrame,
    RelativePosition,
    RoadRoute,
    RouteLeg,
)
from twin.scenario.storyboard.program.program import InitAction

pytestmark = pytest.mark.slow

TIME, RATE, DISTANCE = DynamicsDimension.TIME, DynamicsDimension.RATE, DynamicsDimension.DISTANCE
LINEAR, CUBIC = DynamicsShape.LINEAR, DynamicsShape.CUBIC
SINUSOIDAL, STEP = DynamicsShape.SINUSOIDAL, DynamicsShape.STEP
VALUES = {
    LINEAR: lambda q: q,
    CUBIC: lambda q: 3 * q**2 - 2 * q**3,
    SINUSOIDAL: lambda q: (1 - np.cos(np.pi * q)) / 2,
}
SLOPES = {
    LINEAR: lambda q: np.ones_like(q),
    CUBIC: lambda q: 6 * q * (1 - q),
    SINUSOIDAL: lambda q: np.pi / 2 * np.sin(np.pi * q),
}
PEAKS = {LINEAR: 1.0, CUBIC: 1.5, SINUSOIDAL: math.pi / 2}
BEGIN = 20


@pytest.fixture(scope="module")
def straight():
    """1 km with lanes 2, 1, -1, -2 of 3.5 m."""
    lanes = section(left=lane(2) + lane(1), right=lane(-1) + lane(-2))
    return read_network(xodr(road(1000.0, geometry(LINE, 1000.0), lanes)), "straight.xodr")


@pytest.fixture(scope="module")
def bend():
    """Half a turn to the left of 50 m radius with lanes 1 and -1."""
    length = 50.0 * math.pi
    return read_network(
        xodr(road(length, geometry('<arc curvature="0.02"/>', length))), "bend.xodr"
    )


def on_lane(network, s_m, lane_id, *, offset_m=0.0, road_number=0, against=False):
    frame = list(RoadMap(network).frames.values())[road_number]
    pose = frame.lane_pose(lane_id, s_m, offset_m)
    sign = -1 if lane_id < 0 else 1
    widths = [float(frame.lane_width(sign * k, s_m)) for k in range(1, abs(lane_id) + 1)]
    t = sign * (sum(widths) - widths[-1] / 2) + offset_m
    heading = float(pose.heading_rad) + (math.pi if against else 0.0)
    place = (float(pose.x_m), float(pose.y_m), float(pose.z_m), heading, 0.0, 0.0)
    return FixedPosition(*place, road_number, s_m, t, lane_id, offset_m)


def run(network, action, steps=500, *, place=None, speed_mps=10.0, init=(), cars=1, **options):
    begin = place if place is not None else on_lane(network, 50.0, -1)
    events = [EventPlan(from_time(BEGIN * STEP_S), [action])] if action is not None else []
    plan = program(
        [car(f"car{k}") for k in range(cars)],
        [*start_at(0, begin, speed_mps), *init],
        [GroupPlan((0,), events)],
        **options,
    )
    return played(plan, steps, road_tables(network))


def lane_change(shape, span, change, dimension, speed_mps, steps):
    """The way of a body that changes lanes, step by step as documented."""
    x, y, at = [0.0], [0.0], 0.0
    heading = [0.0]
    step_m = speed_mps * STEP_S
    for _ in range(steps):
        if at >= span - 1e-6:
            x.append(x[-1] + step_m)
            y.append(change)
            heading.append(0.0)
            continue
        slope = change * SLOPES[shape](np.float64(at / span)) / span
        if dimension == DISTANCE:
            ahead = step_m / math.sqrt(1 + slope**2)
            angle = math.atan(slope)
            at = min(at + ahead, span)
        else:
            aside = slope * STEP_S
            ahead = math.sqrt(step_m**2 - aside**2)
            angle = math.atan2(aside, ahead)
            at = min(at + STEP_S, span)
        x.append(x[-1] + ahead)
        y.append(change * VALUES[shape](at / span))
        heading.append(0.0 if at >= span - 1e-6 else angle)
    return np.array(x), np.array(y), np.array(heading)


@pytest.mark.parametrize("shape", [LINEAR, CUBIC, SINUSOIDAL])
@pytest.mark.parametrize(("dimension", "value"), [(TIME, 3.0), (RATE, 1.2), (DISTANCE, 40.0)])
def test_lane_change(straight, shape, dimension, value):
    done = run(straight, LaneChangeAction(dynamics(shape, value, dimension), -1, -2, 0.2))
    change = -3.3
    span = PEAKS[shape] * 3.3 / value if dimension == RATE else value
    x, y, heading = lane_change(shape, span, change, dimension, 10.0, 500 - BEGIN)
    np.testing.assert_allclose(done.x_m[BEGIN:, 0] - done.x_m[BEGIN, 0], x, atol=1e-6)
    np.testing.assert_allclose(done.y_m[BEGIN:, 0], -1.75 + y, atol=1e-6)
    np.testing.assert_allclose(done.heading_rad[BEGIN:, 0], heading, atol=1e-6)
    lanes = np.where(done.y_m[:, 0] >= -3.5, -1, -2)
    assert done.lane[:, 0].tolist() == lanes.tolist()
    ended = steps_of(done.events, "g0.e0", "end")
    assert ended == [BEGIN + int(np.argmax(np.abs(y - change) < 1e-9)) - 1]


def test_lane_change_against_s_counts_from_the_driver(straight):
    """Relative lanes are counted to the left of the entity; here it heads against s."""
    place = on_lane(straight, 500.0, 1, against=True)
    action = LaneChangeAction(dynamics(LINEAR, 2.0), 0, -1, 0.0)
    done = run(straight, action, place=place)
    assert done.lane[-1, 0] == 2
    assert done.x_m[-1, 0] < 460.0
    assert abs(done.heading_rad[-1, 0]) == pytest.approx(math.pi)
    middle = done.heading_rad[BEGIN + 100, 0] % (2 * math.pi)
    assert middle < math.pi  # Towards the right as the driver sees it, and upwards in y.


def test_lane_change_at_once(straight):
    done = run(straight, LaneChangeAction(dynamics(STEP, 0.0), -1, -2, 0.0))
    assert done.y_m[BEGIN, 0] == pytest.approx(-1.75)
    assert done.y_m[BEGIN + 1, 0] == pytest.approx(-5.25)
    assert done.x_m[-1, 0] == pytest.approx(100.0)


def test_lane_change_of_a_body_at_rest_waits(straight):
    done = run(straight, LaneChangeAction(dynamics(LINEAR, 1.0), -1, -2, 0.0), speed_mps=0.0)
    assert done.y_m[-1, 0] == pytest.approx(-1.75)
    assert steps_of(done.events, "g0.e0", "end") == []


@pytest.mark.parametrize("shape", [LINEAR, CUBIC, SINUSOIDAL, STEP])
def test_lane_offset(straight, shape):
    bend = 0.8
    done = run(straight, LaneOffsetAction(shape, bend, -1, 0.9, False))
    span = {
        SINUSOIDAL: math.pi * math.sqrt(0.9 / (2 * bend)),
        STEP: 0.0,
    }.get(shape, math.sqrt(6 * 0.9 / bend))
    # The offset of a row is that of the beginning of the step before it.
    at = np.clip((np.arange(501) - BEGIN - 1) * STEP_S, 0.0, None)
    if shape == STEP:
        expected = np.where(np.arange(501) > BEGIN, 0.9, 0.0)
    else:
        expected = np.where(at >= span - 1e-6, 0.9, 0.9 * VALUES[shape](np.minimum(at / span, 1)))
    np.testing.assert_allclose(done.y_m[:, 0], -1.75 + expected, atol=1e-6)
    np.testing.assert_allclose(done.x_m[:, 0], 50.0 + np.arange(501) * 0.1, atol=1e-6)
    if shape != STEP:
        slope = np.where(at < span, 0.9 * SLOPES[shape](at / max(span, 1e-9)) / max(span, 1e-9), 0)
        slope = np.where(np.arange(501) > BEGIN, slope, 0.0)
        np.testing.assert_allclose(done.heading_rad[:, 0], np.arctan(slope / 10.0), atol=1e-6)


@pytest.mark.parametrize(("lane_id", "radius"), [(1, 48.25), (-1, 51.75)])
def test_default_controller_keeps_speed_on_its_own_way(bend, lane_id, radius):
    done = run(
        bend,
        None,
        200,
        place=on_lane(bend, 80.0 - 60.0 * (lane_id < 0), lane_id, against=lane_id > 0),
    )
    chord = np.hypot(np.diff(done.x_m[:, 0]), np.diff(done.y_m[:, 0]))
    np.testing.assert_allclose(chord, 2 * radius * math.sin(0.1 / radius / 2), atol=1e-6)
    middle = np.hypot(done.x_m[:, 0], done.y_m[:, 0] - 50.0)
    np.testing.assert_allclose(middle, radius, atol=2e-5)


def test_end_of_road(straight):
    plan = program(
        [car()],
        start_at(0, on_lane(straight, 990.0, -1), 10.0),
        [
            GroupPlan(
                (0,),
                [EventPlan(trigger(when(EndOfRoadCondition(0.5), 0)), [speed_at_once(0.0)])],
            )
        ],
    )
    done = played(plan, 300, road_tables(straight))
    assert done.x_m[-1, 0] == pytest.approx(1000.0)
    assert done.speed_mps[-1, 0] == 0.0
    assert 140 <= steps_of(done.events, "g0.e0", "start")[0] <= 153


def test_off_the_road(straight):
    place = on_lane(straight, 50.0, -2)
    away = FixedPosition(50.0, -30.0, 0.0, 0.0, 0.0, 0.0, 0, 50.0, -30.0, 0, -30.0)
    plan = program(
        [car()],
        start_at(0, place, 10.0),
        [
            GroupPlan(
                (0,),
                [
                    EventPlan(from_time(1.0), [TeleportAction(away)]),
                    EventPlan(trigger(when(OffroadCondition(0.5), 0)), [speed_at_once(0.0)]),
                ],
            )
        ],
    )
    done = played(plan, 300, road_tables(straight))
    assert done.lane[102:, 0].tolist() == [0] * 199
    assert steps_of(done.events, "g0.e1", "start") == [151]


@pytest.mark.parametrize("frame", [DistanceFrame.ENTITY, DistanceFrame.ROAD])
@pytest.mark.parametrize(
    ("side", "expected"), [(Displacement.BEHIND, 100.0 - 20.0), (Displacement.AHEAD, 100.0 + 20.0)]
)
def test_distance_without_limits_is_kept_at_once(straight, frame, side, expected):
    action = LongitudinalDistanceAction(1, 20.0, False, False, False, frame, side, MotionLimits())
    other = start_at(1, on_lane(straight, 96.0, -1), 20.0)
    done = run(straight, action, init=other, cars=2)
    assert done.x_m[BEGIN, 1] == pytest.approx(100.0)
    assert done.x_m[BEGIN + 1, 0] == pytest.approx(expected + 0.2)
    assert done.speed_mps[-1, 0] == 20.0
    assert steps_of(done.events, "g0.e0", "end") == [BEGIN + 1]


def test_free_space_distance_is_between_boxes(straight):
    """Cars of 5 m whose origins are 1.5 m from their rear ends."""
    action = LongitudinalDistanceAction(
        1, 20.0, False, True, True, DistanceFrame.ROAD, Displacement.BEHIND, MotionLimits()
    )
    done = run(straight, action, init=start_at(1, on_lane(straight, 96.0, -1), 20.0), cars=2)
    assert done.x_m[-1, 1] - done.x_m[-1, 0] == pytest.approx(20.0 + 3.5 + 1.5, abs=1e-6)


def test_distance_with_limits_is_a_damped_spring(straight):
    """Against the differential equation's steps; limits of 4 and 3 m/s^2 and 40 m/s hold."""
    limits = MotionLimits(4.0, 3.0, 40.0)
    action = LongitudinalDistanceAction(
        1, 20.0, False, False, True, DistanceFrame.ROAD, Displacement.BEHIND, limits
    )
    done = run(straight, action, 1500, init=start_at(1, on_lane(straight, 96.0, -1), 20.0), cars=2)
    x, v = done.x_m[BEGIN, 0], 10.0
    other = done.x_m[BEGIN, 1]
    for row in range(BEGIN, 1500):
        missing = other - x - 20.0
        spring = 0.4 * (4.0 if missing < 0 else 3.0)
        pull = missing * spring + 2 * math.sqrt(spring) * (20.0 - v)
        v = min(max(v + min(max(pull, -3.0), 4.0) * STEP_S, 0.0), 40.0)
        x += v * STEP_S
        other += 0.2
        assert done.x_m[row + 1, 0] == pytest.approx(x, abs=1e-6)
    assert other - x == pytest.approx(20.0, abs=0.05)


def test_lateral_distance(straight):
    """With limits the way aside is bounded; without it is gone at once."""
    other = start_at(1, on_lane(straight, 50.0, -2), 10.0)
    for limits, most in ((MotionLimits(), 9.9), (MotionLimits(1.0, 1.0, 0.5), 0.5 * STEP_S)):
        action = LateralDistanceAction(
            1, 2.6, False, True, DistanceFrame.LANE, Displacement.AHEAD, limits
        )
        done = run(straight, action, init=other, cars=2)
        assert done.y_m[-1, 0] - done.y_m[-1, 1] == pytest.approx(2.6, abs=0.02)
        assert np.abs(np.diff(done.y_m[:, 0])).max() <= most + 1e-9


def test_routes_choose_ways_through_junctions():
    """One road in front of a junction with three ways out, each taken by its route."""
    network = junction()
    numbers = {name: index for index, name in enumerate(network.roads)}
    ways = list(next(iter(network.junctions.values())).connections)
    entry = ways[0].incoming_road
    lane_id = -1 if network.roads[entry].sections[0].lane(-1) else 1
    ends = set()
    tables = road_tables(network)
    for way in [way for way in ways if way.incoming_road == entry]:
        legs = (
            RouteLeg(numbers[entry], 0.0, 10.0, 0),
            RouteLeg(numbers[way.connecting_road], 0.0, 5.0, 0),
        )
        place = on_lane(network, 1.0, lane_id, road_number=numbers[entry])
        for action in (
            AssignRouteAction(0),
            AcquirePositionAction(place, (0,) * (2 * len(numbers))),
        ):
            plan = program(
                [car()],
                [*start_at(0, place, 10.0), InitAction(action, 0)],
                routes=[RoadRoute("r", False, legs)],
            )
            done = played(plan, 600, tables)
            x, y = round(float(done.x_m[-1, 0]), 3), round(float(done.y_m[-1, 0]), 3)
            ends.add((way.connecting_road, x, y))
    taken = {name for name, _, _ in ends}
    assert len(ends) == len({(x, y) for _, x, y in ends}) == len(taken) > 1


@pytest.mark.parametrize(
    ("frame", "a", "b", "lanes", "expected"),
    [
        (RelativeFrame.WORLD, 3.0, -2.0, 0, (103.0, -3.75)),
        (RelativeFrame.OBJECT, 3.0, 2.0, 0, (103.0, 0.25)),
        (RelativeFrame.ROAD, 20.0, 1.0, 0, (120.0, -0.75)),
        (RelativeFrame.LANE, -30.0, 0.5, -1, (70.0, -4.75)),
        (RelativeFrame.LANE, 0.0, 0.0, 1, (100.0, 1.75)),
        (RelativeFrame.LANE_LENGTH, 7.0, 0.0, 0, (107.0, -1.75)),
    ],
)
def test_relative_places(straight, frame, a, b, lanes, expected):
    """They are relative to where the other stands, whichever stands first in Init."""
    place = RelativePosition(frame, 1, a, b, 0.0, lanes)
    for order in (1, -1):
        init = [
            InitAction(TeleportAction(on_lane(straight, 100.0, -1)), 1),
            InitAction(TeleportAction(place), 0),
        ][::order]
        if order < 0:
            init.insert(0, init[1])
        plan = program([car("a"), car("b")], init)
        done = played(plan, 1, road_tables(straight))
        if order > 0:
            assert done.x_m[0, 0] == pytest.approx(expected[0])
            assert done.y_m[0, 0] == pytest.approx(expected[1])
        assert done.x_m[0, 1] == pytest.approx(100.0)
