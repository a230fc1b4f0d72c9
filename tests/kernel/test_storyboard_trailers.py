"""Trailers behind their tractors, against the tractrix and the circle of a steady turn."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import geometry, road, xodr
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
    trigger,
    when,
)

from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.road_map import RoadMap
from twin.road.tables.road_tables import road_tables
from twin.scenario.storyboard.player.storyboard_player import StoryboardPlayer
from twin.scenario.storyboard.program.actions import (
    ConnectTrailerAction,
    DisconnectTrailerAction,
    SetVariableAction,
    TeleportAction,
)
from twin.scenario.storyboard.program.conditions import CollisionCondition
from twin.scenario.storyboard.program.places import FixedPosition
from twin.scenario.storyboard.program.program import InitAction, ProgramVariable

HITCH_M, COUPLER_M = -1.0, 4.0


def truck(**changes):
    return car("truck", hitch_x_m=HITCH_M, **changes)


def trailer(name="trailer", tractor=0, **changes):
    fields = {"coupler_x_m": COUPLER_M, "tractor": tractor} | changes
    return car(name, **fields)


def hitched(x_m, y_m, heading_rad, angle_rad):
    """Where a trailer starts whose coupler is at a hitch, turned by an angle to its tractor."""
    hitch = x_m + HITCH_M * math.cos(heading_rad), y_m + HITCH_M * math.sin(heading_rad)
    turned = heading_rad + angle_rad
    return at(
        hitch[0] - COUPLER_M * math.cos(turned), hitch[1] - COUPLER_M * math.sin(turned), turned
    )


def gaps(run, tractor=0, towed=1, hitch_m=HITCH_M, coupler_m=COUPLER_M):
    """Distances between hitch and coupler in every state."""
    x = run.x_m[:, tractor] + hitch_m * np.cos(run.heading_rad[:, tractor])
    y = run.y_m[:, tractor] + hitch_m * np.sin(run.heading_rad[:, tractor])
    x -= run.x_m[:, towed] + coupler_m * np.cos(run.heading_rad[:, towed])
    y -= run.y_m[:, towed] + coupler_m * np.sin(run.heading_rad[:, towed])
    return np.hypot(x, y)


@pytest.mark.parametrize("angle_rad", [0.3, -1.2, 2.5])
@pytest.mark.parametrize("heading_rad", [0.0, 2.0])
def test_a_straight_pull_is_a_tractrix(angle_rad, heading_rad):
    speed_mps = 5.0
    init = start_at(0, at(20.0, 3.0, heading_rad), speed_mps)
    init.append(InitAction(TeleportAction(hitched(20.0, 3.0, heading_rad, angle_rad)), 1))
    run = played(program([truck(), trailer()], init), 300)
    assert gaps(run).max() < 1e-12
    way = speed_mps * STEP_S * np.arange(301)
    half = np.tan(angle_rad / 2.0) * np.exp(-way / COUPLER_M)
    turned = np.remainder(run.heading_rad[:, 1] - heading_rad + np.pi, 2 * np.pi) - np.pi
    np.testing.assert_allclose(np.tan(turned / 2.0), half, rtol=1e-9, atol=1e-12)
    # The axle goes where it points: its speed is the tractor's along that, in the middle of a step.
    between = (turned[:-1] + turned[1:]) / 2.0
    np.testing.assert_allclose(
        run.speed_mps[1:, 1], speed_mps * np.cos(between), rtol=0.0, atol=1e-3
    )


def test_a_trailer_that_nobody_puts_anywhere_stands_straight_behind():
    run = played(program([truck(), trailer()], start_at(0, at(20.0, 3.0, 1.0), 0.0)), 3)
    assert gaps(run).max() < 1e-12
    np.testing.assert_array_equal(run.heading_rad[:, 1], run.heading_rad[:, 0])


def test_a_steady_turn_has_the_radii_of_the_circle():
    """Hitch at R_h^2 = R^2 + h^2, axle at R_t^2 = R_h^2 - L^2 about the same middle."""
    radius = 30.0
    length = 2.0 * math.pi * radius
    network = read_network(
        xodr(road(length, geometry(f'<arc curvature="{1 / radius}"/>', length))), "circle.xodr"
    )
    pose = next(iter(RoadMap(network).frames.values())).pose(1.0, 0.0)
    place = FixedPosition(
        float(pose.x_m), float(pose.y_m), 0.0, float(pose.heading_rad), 0.0, 0.0, 0, 1.0, 0.0
    )
    plan = program([truck(), trailer()], start_at(0, place, 10.0))
    steps = 1700
    run = played(plan, steps, road_tables(network))
    assert gaps(run).max() < 1e-9
    from_middle = np.hypot(run.x_m, run.y_m - radius)[-1]
    assert from_middle[0] == pytest.approx(radius, abs=1e-6)
    assert from_middle[1] == pytest.approx(
        math.sqrt(radius**2 + HITCH_M**2 - COUPLER_M**2), abs=1e-4
    )
    assert run.speed_mps[-1, 1] == pytest.approx(10.0 * from_middle[1] / radius, abs=1e-3)


def test_a_train_is_pulled_from_its_front():
    """The last stands first among the entities: the order of entities does not matter."""
    last = trailer("last", tractor=1)
    middle = trailer("middle", tractor=2, hitch_x_m=-1.5)
    plan = program([last, middle, truck()], start_at(2, at(0.0, 0.0, 0.5), 8.0))
    run = played(plan, 50)
    assert gaps(run, 2, 1).max() < 1e-12
    assert gaps(run, 1, 0, hitch_m=-1.5).max() < 1e-12
    np.testing.assert_allclose(run.heading_rad, 0.5, atol=1e-12)


def test_a_tractor_that_is_put_elsewhere_takes_its_trailer_along():
    there = at(500.0, 100.0, -2.0)
    events = [EventPlan(from_time(0.1), [TeleportAction(there)])]
    plan = program([truck(), trailer()], start_at(0, at(0.0), 6.0), [GroupPlan((0,), events)])
    run = played(plan, 30)
    assert gaps(run).max() < 1e-12
    assert run.heading_rad[-1, 1] == pytest.approx(-2.0)
    assert run.speed_mps[11:, 1] == pytest.approx(6.0)


def test_connect_and_let_go():
    events = [
        EventPlan(from_time(1.0), [ConnectTrailerAction(1)]),
        EventPlan(from_time(2.0), [DisconnectTrailerAction()]),
    ]
    init = start_at(0, at(0.0), 5.0) + start_at(1, at(-3.0, 2.0, 0.4), 0.0)
    plan = program([truck(), trailer(tractor=-1)], init, [GroupPlan((0,), events)])
    run = played(plan, 300)
    apart = gaps(run)
    assert run.x_m[100, 1] == -3.0
    assert apart[101:201].max() < 1e-12
    # At the moment it turns to the hitch from where it stands.
    hitch = 5.0 * 1.01 - 1.0
    assert run.heading_rad[101, 1] == pytest.approx(math.atan2(-2.0, hitch + 3.0))
    # Then it rolls on by itself, where it points.
    rolled = np.hypot(np.diff(run.x_m[201:, 1]), np.diff(run.y_m[201:, 1]))
    assert rolled == pytest.approx(run.speed_mps[200, 1] * STEP_S, abs=1e-9)
    assert len(np.unique(run.heading_rad[201:, 1])) == 1


def test_a_trailer_hangs_on_the_hitch_that_took_it_last():
    events = [EventPlan(from_time(0.1), [ConnectTrailerAction(2)])]
    other = car("other", hitch_x_m=HITCH_M)
    init = start_at(0, at(0.0), 5.0) + start_at(1, at(0.0, 20.0), 5.0)
    plan = program([truck(), other, trailer()], init, [GroupPlan((1,), events)])
    run = played(plan, 40)
    assert gaps(run, 0, 2)[:11].max() < 1e-12
    assert gaps(run, 1, 2)[11:].max() < 1e-12


def test_nobody_tows_his_own_tractor():
    """A trailer with a hitch that is to couple its tractor does nothing."""
    events = [EventPlan(from_time(0.1), [ConnectTrailerAction(0)])]
    front = truck(coupler_x_m=3.0)
    plan = program(
        [front, trailer(hitch_x_m=-2.0)], start_at(0, at(0.0), 5.0), [GroupPlan((1,), events)]
    )
    run = played(plan, 40)
    assert gaps(run).max() < 1e-12
    assert run.x_m[-1, 0] == pytest.approx(2.0)


def test_actions_of_towed_bodies_move_nobody():
    events = [EventPlan(from_time(0.1), [speed_at_once(30.0)])]
    plan = program([truck(), trailer()], start_at(0, at(0.0), 5.0), [GroupPlan((1,), events)])
    run = played(plan, 40)
    assert gaps(run).max() < 1e-12
    assert ("g0.e0", "end") in [(name, kind) for _, name, kind in run.events]


def test_an_imposed_tractor_pulls_its_trailer():
    player = StoryboardPlayer(
        [program([truck(), trailer()], start_at(0, at(0.0), 0.0))], None, 1, step_s=STEP_S
    )
    player.start(0, 0)
    for step in range(100):
        x_m = 0.05 * (step + 1)
        player.impose(0, 0, x_m, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0)
        player.step()
        states = player.states()
        assert states.x_m[0, 1] == pytest.approx(x_m + HITCH_M - COUPLER_M, abs=1e-12)
    assert states.speed_mps[0, 1] == pytest.approx(5.0, abs=1e-9)


def test_a_train_does_not_collide_with_itself():
    """A semi-trailer lies above its tractor; another car does not."""
    above = trailer("semi", hitch_x_m=-2.0, coupler_x_m=1.0)
    touch = trigger(when(CollisionCondition(-1, -1), 0, 1, 2))
    events = [EventPlan(touch, [SetVariableAction(0, 1.0)])]
    entities = [truck(), above, trailer("last", tractor=1)]
    init = start_at(0, at(20.0), 5.0)
    for others, hit in (([], 0.0), ([car("other")], 1.0)):
        more = start_at(3, at(22.0, 1.5), 0.0) if others else []
        plan = program(
            [*entities, *others],
            init + more,
            [GroupPlan((0,), events)],
            variables=[ProgramVariable("variable hit", 0.0)],
        )
        run = played(plan, 3)
        assert run.player.variables(0)["variable hit"] == hit
