"""What a slot follows stays its own while programs before it in the tables come and go.

Trajectories, routes, driver models and environments are rows of tables that all programs of a rig
share. A program that gives its place to one with more or fewer of them moves the rows behind it.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from road_networks import junction
from storyboard_programs import (
    STEP_S,
    EventPlan,
    GroupPlan,
    at,
    car,
    from_time,
    program,
    speed_at_once,
    start_at,
    trigger,
    when,
)

from twin.road.opendrive.road_map import RoadMap
from twin.road.tables.road_tables import road_tables
from twin.scenario.storyboard.case.rig_player import RigPlayer
from twin.scenario.storyboard.program.actions import (
    AssignRouteAction,
    ControllerAction,
    EnvironmentAction,
    FollowTrajectoryAction,
)
from twin.scenario.storyboard.program.conditions import ComparisonRule, TimeOfDayCondition
from twin.scenario.storyboard.program.places import (
    FixedPosition,
    RoadRoute,
    RouteLeg,
    Trajectory,
    TrajectoryPiece,
)
from twin.scenario.storyboard.program.program import (
    DriverModel,
    InitAction,
    Program,
    StoryboardEnvironment,
)

BEGUN = 20
"""Steps that the watched slot has made when the other one takes another program."""
STEPS = 600
BEGIN_M = 30.0
"""Where the car begins on its road, which is 50 m long."""
FLAT = (0.0,) * 4
NETWORK = junction()
ROADS = road_tables(NETWORK)
NUMBERS = {name: index for index, name in enumerate(NETWORK.roads)}
CROSSING = list(next(iter(NETWORK.junctions.values())).connections)
ENTRY = CROSSING[0].incoming_road
WAYS = [way.connecting_road for way in CROSSING if way.incoming_road == ENTRY]
"""Roads through a junction from one that leads to it."""


def entry() -> FixedPosition:
    """A place on the road that leads to the junction."""
    lane = -1 if NETWORK.roads[ENTRY].sections[0].lane(-1) else 1
    roads = RoadMap(NETWORK)
    pose = roads.frames[ENTRY].lane_pose(lane, BEGIN_M, 0.0)
    x_m, y_m = float(pose.x_m), float(pose.y_m)
    t_m = float(roads.lane_under(x_m, y_m).t_m)
    turned = float(pose.heading_rad)
    return FixedPosition(x_m, y_m, 0.0, turned, 0.0, 0.0, NUMBERS[ENTRY], BEGIN_M, t_m, lane)


def follower(*lines_y_m: float, late: bool = False) -> Program:
    """Follows the last of lines along x, from the beginning on or only after 0.1 s."""
    lines = [
        Trajectory(
            "line",
            closed=False,
            timed=False,
            pieces=(
                TrajectoryPiece(0.0, 500.0, (0.0, 1.0, 0.0, 0.0), (y_m, 0.0, 0.0, 0.0), FLAT, FLAT),
            ),
        )
        for y_m in lines_y_m
    ]
    action = FollowTrajectoryAction(
        trajectory=len(lines) - 1,
        timed=False,
        absolute_time=False,
        time_scale=1.0,
        time_offset_s=0.0,
        follow=True,
        initial_distance_m=0.0,
    )
    init = start_at(0, at(0.0), 10.0)
    if late:
        events = [EventPlan(from_time(0.1), [action])]
        return program([car()], init, [GroupPlan((0,), events)], trajectories=lines)
    return program([car()], [*init, InitAction(action, 0)], trajectories=lines)


def router(*ways: str) -> Program:
    """Drives through the junction by the last of its routes."""
    routes = [
        RoadRoute(
            "route",
            False,
            (RouteLeg(NUMBERS[ENTRY], 0.0, 10.0, 0), RouteLeg(NUMBERS[way], 0.0, 5.0, 0)),
        )
        for way in ways
    ]
    init = [*start_at(0, entry(), 10.0), InitAction(AssignRouteAction(len(ways) - 1), 0)]
    return program([car()], init, routes=routes)


def driven(*speeds_mps: float) -> Program:
    """Drives by the last of its models."""
    models = [DriverModel(speed_mps, politeness=-1.0) for speed_mps in speeds_mps]
    action = ControllerAction(True, True, len(models) - 1)
    return program([car()], [*start_at(0, at(0.0), 10.0), InitAction(action, 0)], models=models)


def timed(*clocks_s: float) -> Program:
    """Is faster from 1000.5 s on, by the clock of the last of its environments."""
    expression = TimeOfDayCondition(1000.5, ComparisonRule.GREATER_OR_EQUAL)
    plan = program(
        [car()],
        [*start_at(0, at(0.0), 1.0), InitAction(EnvironmentAction(len(clocks_s) - 1))],
        [GroupPlan((0,), [EventPlan(trigger(when(expression)), [speed_at_once(2.0)])])],
    )
    environments = tuple(StoryboardEnvironment("e", time_of_day_s=s) for s in clocks_s)
    return msgspec.structs.replace(plan, environments=environments)


PLAIN = program([car()], start_at(0, at(0.0), 10.0))
"""Has a row of none of them."""
WATCHED = {
    "trajectory": (follower(30.0), follower(1.0, 2.0, 3.0)),
    "route": (router(WAYS[-1]), router(WAYS[0], WAYS[0], WAYS[0])),
    "driver model": (driven(33.0), driven(5.0, 6.0, 7.0)),
    "environment": (timed(1000.0), timed(0.0, 1.0, 2.0)),
}
"""A program that has one, and another that has three, all different."""


def rows_of(player: RigPlayer, slot: int, steps: int) -> list[tuple[bytes, bytes]]:
    """States of the first body of a slot after each of so many steps."""
    rows = []
    for _ in range(steps):
        player.step()
        rows.append(
            (
                player.bodies.reals.numpy()[slot, 0].tobytes(),
                player.bodies.wholes.numpy()[slot, 0].tobytes(),
            )
        )
    return rows


def alone(watched: Program) -> list[tuple[bytes, bytes]]:
    player = RigPlayer(watched, ROADS, 1, STEP_S, "cpu")
    player.begin(0, watched, -1)
    return rows_of(player, 0, STEPS)


def beside(watched: Program, neighbours: Sequence[Program]) -> list[tuple[bytes, bytes]]:
    """The watched slot's states while the slot before it runs one program after the other."""
    player = RigPlayer(neighbours[0], ROADS, 2, STEP_S, "cpu")
    player.begin(0, neighbours[0], -1)
    player.begin(1, watched, -1)
    rows = rows_of(player, 1, BEGUN)
    for neighbour in neighbours[1:]:
        player.begin(0, neighbour, -1)
        rows += rows_of(player, 1, BEGUN)
    return rows + rows_of(player, 1, STEPS - len(rows))


@pytest.mark.parametrize("what", WATCHED)
def test_each_kind_of_row_matters(what):
    """Else the tests below would not see that a slot reads another's."""
    watched, other = WATCHED[what]
    assert alone(watched)[-1][0] != alone(other)[-1][0]


@pytest.mark.parametrize("what", WATCHED)
def test_a_program_with_more_rows_comes_before(what):
    watched, other = WATCHED[what]
    assert beside(watched, [PLAIN, other]) == alone(watched)


@pytest.mark.parametrize("what", WATCHED)
def test_a_program_with_more_rows_goes(what):
    """A row that has moved forward stood past the end of the table: it was read from there."""
    watched, other = WATCHED[what]
    assert beside(watched, [other, PLAIN, other, PLAIN]) == alone(watched)


@pytest.mark.parametrize("what", WATCHED)
def test_a_slot_goes_on_where_its_program_has_another_place(what):
    watched, other = WATCHED[what]
    player = RigPlayer(other, ROADS, 2, STEP_S, "cpu")
    player.begin(0, other, -1)
    player.begin(1, watched, -1)
    rows = rows_of(player, 1, BEGUN)
    saved = player.save(1)
    second = RigPlayer(watched, ROADS, 1, STEP_S, "cpu")
    second.begin(0, watched, -1)
    second.restore(0, saved)
    assert rows + rows_of(second, 0, STEPS - BEGUN) == alone(watched)


def test_a_body_that_is_let_go_follows_its_own_trajectory():
    """While something else moves it, an action that begins does not put it on its line."""
    watched, other = follower(1.0, 30.0, late=True), follower(5.0, 6.0, 7.0)
    player = RigPlayer(watched, None, 2, STEP_S, "cpu")
    player.begin(0, watched, -1)
    player.begin(1, other, -1)
    for _ in range(BEGUN):
        player.impose(0, 0, -50.0, -9.0, 0.0, 0.0, 0.0, 0.0, 10.0)
        player.step()
    assert player.states().y_m[0, 0] == -9.0
    player.release(0, 0)
    player.step()
    states = player.states()
    assert (states.x_m[0, 0], states.y_m[0, 0]) == (pytest.approx(0.1), 30.0)
