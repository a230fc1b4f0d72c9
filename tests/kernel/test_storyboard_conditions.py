"""Conditions on entities: when they become true, against closed forms, on open ground."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
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
    speed_over,
    start_at,
    steps_of,
    trigger,
    when,
)

from twin.scenario.storyboard.program.actions import EnvironmentAction, SetVariableAction
from twin.scenario.storyboard.program.conditions import (
    AccelerationCondition,
    AngleCondition,
    AngleKind,
    CollisionCondition,
    ComparisonRule,
    ConditionEdge,
    DistanceCondition,
    DistanceFrame,
    DistanceKind,
    ReachPositionCondition,
    RelativeAngleCondition,
    RelativeDistanceCondition,
    RelativeSpeedCondition,
    SpeedAxis,
    SpeedCondition,
    StandStillCondition,
    TimeHeadwayCondition,
    TimeOfDayCondition,
    TimeToCollisionCondition,
    TrafficSignalCondition,
    TraveledDistanceCondition,
)
from twin.scenario.storyboard.program.entities import BodyBox, EntityCategory
from twin.scenario.storyboard.program.places import RelativeFrame, RelativePosition
from twin.scenario.storyboard.program.program import (
    InitAction,
    Program,
    ProgramVariable,
    StoryboardEnvironment,
)

ENTITY, WORLD, ROAD = DistanceFrame.ENTITY, DistanceFrame.WORLD, DistanceFrame.ROAD
ALONG, ASIDE, STRAIGHT = (
    DistanceKind.LONGITUDINAL,
    DistanceKind.LATERAL,
    DistanceKind.EUCLIDEAN,
)
LESS, GREATER = ComparisonRule.LESS, ComparisonRule.GREATER
"""Cars of 5 m x 2 m whose origins are 1.5 m from their rear ends."""


def starts(expression, *, bodies, entity=0, steps=400, others=(), edge=ConditionEdge.NONE):
    """The step at which a condition of an entity is first true; None: never."""
    entities, init = [], []
    for number, (place, speed_mps) in enumerate(bodies):
        entities.append(car(f"car{number}"))
        init += start_at(number, place, speed_mps)
    events = [
        EventPlan(trigger(when(expression, entity, edge=edge)), [SetVariableAction(0, 1.0)]),
        *others,
    ]
    plan = program(
        entities,
        init,
        [GroupPlan((entity,), events)],
        variables=[ProgramVariable("v", 0.0)],
    )
    done = played(plan, steps)
    first = steps_of(done.events, "g0.e0", "start")
    return first[0] if first else None


BEHIND = [(at(0.0), 20.0), (at(50.0), 10.0)]
"""A car that comes nearer to another by 10 m/s."""


@pytest.mark.parametrize(
    ("expression", "step"),
    [
        (RelativeDistanceCondition(1, 30.0, LESS, False, ENTITY, ALONG), 201),
        (RelativeDistanceCondition(1, 30.0, LESS, False, ROAD, ALONG), 201),
        (RelativeDistanceCondition(1, 30.0, LESS, True, ENTITY, ALONG), 151),
        (RelativeDistanceCondition(1, 30.0, LESS, True, ENTITY, STRAIGHT), 151),
        (RelativeDistanceCondition(1, 30.0, LESS, False, ENTITY, ASIDE), 0),
        (TimeHeadwayCondition(1, 1.0, LESS, False, ENTITY, ALONG), 301),
        (TimeHeadwayCondition(1, 1.0, LESS, True, ENTITY, ALONG), 251),
        (TimeToCollisionCondition(1, None, 2.0, LESS, False, ENTITY, ALONG), 301),
        (TimeToCollisionCondition(1, None, 2.0, LESS, True, ENTITY, ALONG), 251),
        (TimeToCollisionCondition(-1, at(60.0), 1.0, LESS, False, ENTITY, ALONG), 201),
        (DistanceCondition(at(60.0), 20.0, LESS, False, ENTITY, ALONG), 201),
        (DistanceCondition(at(60.0), 20.0, LESS, True, ENTITY, ALONG), 183),
        (ReachPositionCondition(at(60.0, 3.0), 5.0), 280),
        (
            ReachPositionCondition(RelativePosition(RelativeFrame.OBJECT, 1, -20.0, 0.0), 5.0),
            250,
        ),
        (TraveledDistanceCondition(33.3), 167),
        (CollisionCondition(1, -1), None),
        (StandStillCondition(0.1), None),
    ],
)
def test_nearer(expression, step):
    assert starts(expression, bodies=BEHIND) == step


def test_distances_count_behind_as_well_but_headways_do_not():
    bodies = [(at(50.0), 10.0), (at(0.0), 20.0)]
    near = RelativeDistanceCondition(1, 30.0, LESS, False, ENTITY, ALONG)
    assert starts(near, bodies=bodies) == 201
    headway = TimeHeadwayCondition(1, 100.0, LESS, False, ENTITY, ALONG)
    assert starts(headway, bodies=bodies) is None


def test_no_time_to_collision_of_those_that_part():
    expression = TimeToCollisionCondition(1, None, 1e6, LESS, False, ENTITY, ALONG)
    assert starts(expression, bodies=[(at(0.0), 10.0), (at(50.0), 20.0)]) is None


def test_boxes_touch():
    """The front of the first is 3.5 m ahead of its origin, the other's rear 1.5 m behind."""
    expression = CollisionCondition(1, -1)
    bodies = [(at(0.0), 20.0), (at(25.0, 1.99), 10.0)]
    assert starts(expression, bodies=bodies) == 200
    bodies = [(at(0.0), 20.0), (at(25.0, 2.01), 10.0)]
    assert starts(expression, bodies=bodies) is None


@pytest.mark.parametrize(
    ("category", "hit"),
    [
        (-1, True),
        (-2, True),
        (-3, False),
        (-4, False),
        (EntityCategory.CAR, True),
        (EntityCategory.TRUCK, False),
    ],
)
def test_boxes_of_a_category_touch(category, hit):
    step = starts(CollisionCondition(-1, category), bodies=[(at(0.0), 20.0), (at(25.0), 10.0)])
    assert step == (200 if hit else None)


@pytest.mark.parametrize(
    ("axis", "value", "step"),
    [
        (SpeedAxis.TOTAL, 15.0, 150),
        (SpeedAxis.LONGITUDINAL, 15.0, 151),
        (SpeedAxis.LATERAL, 0.5, None),
        (SpeedAxis.VERTICAL, 0.5, None),
    ],
)
def test_speeds_and_axes(axis, value, step):
    """10 to 20 m/s from 1 s on in 1 s; a component is that of the last step's way."""
    faster = EventPlan(from_time(1.0), [speed_over(1.0, 20.0)])
    expression = SpeedCondition(value, ComparisonRule.GREATER_OR_EQUAL, axis)
    first = starts(expression, bodies=[(at(0.0, 0.0, 0.7), 10.0)], others=[faster])
    assert first == step or (step == 151 and first == 150)


def test_relative_speed_and_acceleration():
    faster = EventPlan(from_time(1.0), [speed_over(1.0, 20.0)])
    bodies = [(at(0.0), 10.0), (at(0.0, 9.0), 12.0)]
    expression = RelativeSpeedCondition(1, 3.0, GREATER, SpeedAxis.TOTAL)
    assert starts(expression, bodies=bodies, others=[faster]) == 151
    expression = AccelerationCondition(9.0, GREATER, SpeedAxis.LONGITUDINAL)
    assert starts(expression, bodies=bodies, others=[faster]) == 101


def test_stands_for_a_time():
    stops = EventPlan(from_time(1.0), [speed_at_once(0.0)])
    first = starts(StandStillCondition(0.5), bodies=[(at(0.0), 10.0)], others=[stops])
    assert first == 151


def test_angles():
    bodies = [(at(0.0, 0.0, 3.1), 5.0), (at(0.0, 9.0, -3.1), 5.0)]
    near = AngleCondition(AngleKind.HEADING, -3.13, 0.1, WORLD)
    assert starts(near, bodies=bodies) == 0
    far = AngleCondition(AngleKind.HEADING, -3.13, 0.01, WORLD)
    assert starts(far, bodies=bodies) is None
    between = 6.2 - 2 * math.pi
    assert starts(RelativeAngleCondition(1, AngleKind.HEADING, between, 0.01), bodies=bodies) == 0
    assert starts(RelativeAngleCondition(1, AngleKind.PITCH, 0.1, 0.01), bodies=bodies) is None


def test_time_of_day_runs_from_the_environment_on():
    expression = TimeOfDayCondition(1000.5, ComparisonRule.GREATER_OR_EQUAL)
    plan = program(
        [car()],
        [*start_at(0, at(0.0), 1.0), InitAction(EnvironmentAction(1))],
        [GroupPlan((0,), [EventPlan(trigger(when(expression)), [speed_at_once(2.0)])])],
    )
    environments = (StoryboardEnvironment("a"), StoryboardEnvironment("b", time_of_day_s=1000.0))
    import msgspec

    plan = msgspec.structs.replace(plan, environments=environments)
    assert steps_of(played(plan, 100).events, "g0.e0", "start") == [50]


def test_signals_are_variables():
    green = trigger(when(TrafficSignalCondition(0, 3.0)))
    events = [
        EventPlan(from_time(1.0), [SetVariableAction(0, 3.0)]),
        EventPlan(green, [speed_at_once(2.0)]),
    ]
    plan = program(
        [car()],
        start_at(0, at(0.0), 1.0),
        [GroupPlan((0,), events)],
        variables=[ProgramVariable("signal", 1.0)],
    )
    assert steps_of(played(plan, 150).events, "g0.e1", "start") == [100]


def corners(place, box):
    x, y, heading = place
    cosine, sine = math.cos(heading), math.sin(heading)
    ends = [
        (box.centre_x_m + a * box.length_m / 2, box.centre_y_m + b * box.width_m / 2)
        for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    return np.array([(x + cosine * u - sine * v, y + sine * u + cosine * v) for u, v in ends])


def edge_distance(one, other):
    """Distance of two quadrilaterals, by sampling each side of both."""
    mix = np.linspace(0.0, 1.0, 401)[:, None]
    sides = [
        np.concatenate([c * (1 - mix) + d * mix for c, d in zip(q, np.roll(q, -1, 0), strict=True)])
        for q in (one, other)
    ]
    least = np.inf
    for point in sides[0][::5]:
        least = min(least, float(np.hypot(*(sides[1] - point).T).min()))
    return least


PLACES = st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.floats(-math.pi, math.pi))


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(first=PLACES, second=PLACES)
def test_distances_of_boxes_against_sampled_sides(first, second):
    """Whether boxes touch, and how far apart they are, for any two cars and a truck's box."""
    small, large = car().box, BodyBox(3.0, 0.5, 1.5, 9.0, 2.5, 3.0)
    far = edge_distance(corners(first, small), corners(second, large))
    verdicts = {}
    for name, expression in (
        ("near", RelativeDistanceCondition(1, far + 0.05, LESS, True, ENTITY, STRAIGHT)),
        ("not nearer", RelativeDistanceCondition(1, far - 0.05, GREATER, True, ENTITY, STRAIGHT)),
        ("touch", CollisionCondition(1, -1)),
    ):
        verdicts[name] = _once(expression, [(first, small), (second, large)])
    if verdicts["touch"]:
        centre_in = far < 0.05 or _inside(first, small, second, large)
        assert centre_in
    else:
        assert verdicts["near"]
        assert verdicts["not nearer"]
        assert far > 0.0


def _inside(first, small, second, large):
    """Whether a corner of either box lies in the other."""
    for place, box, points in (
        (first, small, corners(second, large)),
        (second, large, corners(first, small)),
    ):
        x, y, heading = place
        cosine, sine = math.cos(heading), math.sin(heading)
        dx, dy = points[:, 0] - x, points[:, 1] - y
        ahead = dx * cosine + dy * sine - box.centre_x_m
        left = dy * cosine - dx * sine - box.centre_y_m
        if (
            (np.abs(ahead) <= box.length_m / 2 + 0.02) & (np.abs(left) <= box.width_m / 2 + 0.02)
        ).any():
            return True
    return False


def _once(expression, bodies) -> bool:
    entities, init = [], []
    for number, (place, box) in enumerate(bodies):
        entities.append(car(f"car{number}", box=box))
        init += start_at(number, at(*place), 0.0)
    plan: Program = program(
        entities,
        init,
        [GroupPlan((0,), [EventPlan(trigger(when(expression, 0)), [speed_at_once(0.0)])])],
    )
    return bool(steps_of(played(plan, 1).events, "g0.e0", "start"))


def test_step_of_the_tests():
    assert STEP_S == 0.01
