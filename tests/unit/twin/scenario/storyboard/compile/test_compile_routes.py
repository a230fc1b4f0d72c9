"""Routes: legs along lanes from waypoint to waypoint, and the ways to a place that is acquired."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from compiled_text import compiled, scenario_text

from twin.scenario.storyboard.program.actions import AcquirePositionAction, AssignRouteAction
from twin.scenario.storyboard.program.places import RouteLeg
from twin.scenario.storyboard.program.program import Program


def _waypoint(road: str, lane: int, s: float) -> str:
    return (
        '<Waypoint routeStrategy="shortest"><Position>'
        f'<LanePosition roadId="{road}" laneId="{lane}" s="{s}"/></Position></Waypoint>'
    )


def _routed(folder: Path, inner: str) -> Program:
    action = f"<PrivateAction><RoutingAction>{inner}</RoutingAction></PrivateAction>"
    return compiled(folder, scenario_text(action=action)).program


def _assign(*waypoints: str) -> str:
    return (
        f'<AssignRouteAction><Route name="r" closed="false">{"".join(waypoints)}</Route>'
        "</AssignRouteAction>"
    )


def test_along_the_roads(tmp_path: Path) -> None:
    program = _routed(tmp_path, _assign(_waypoint("a", -1, 20), _waypoint("b", -1, 30)))
    (route,) = program.routes
    assert (route.name, route.closed) == ("r", False)
    assert route.legs == (RouteLeg(0, 20.0, 200.0, -1), RouteLeg(1, 0.0, 30.0, -1))
    assert program.elements[6].action == AssignRouteAction(0)


def test_against_the_roads(tmp_path: Path) -> None:
    program = _routed(tmp_path, _assign(_waypoint("b", 2, 30), _waypoint("a", 2, 20)))
    assert program.routes[0].legs == (RouteLeg(1, 30.0, 0.0, 2), RouteLeg(0, 200.0, 20.0, 2))


def test_waypoints_in_between_join_to_one_leg(tmp_path: Path) -> None:
    places = [_waypoint("a", -1, s) for s in (20, 50, 50, 90)]
    program = _routed(tmp_path, _assign(*places))
    assert program.routes[0].legs == (RouteLeg(0, 20.0, 90.0, -1),)


def test_ways_to_a_place(tmp_path: Path) -> None:
    goal = '<Position><LanePosition roadId="b" laneId="-1" s="30"/></Position>'
    program = _routed(tmp_path, f"<AcquirePositionAction>{goal}</AcquirePositionAction>")
    action = program.elements[6].action
    assert isinstance(action, AcquirePositionAction)
    assert (action.position.road, action.position.lane) == (1, -1)  # type: ignore[union-attr]
    along_a, against_a, along_b, against_b = action.routes
    assert program.routes[along_a].legs == (
        *(RouteLeg(0, 0.0, 200.0, -1), RouteLeg(1, 0.0, 30.0, -1)),
    )
    assert program.routes[along_b].legs == (RouteLeg(1, 0.0, 30.0, -1),)
    # Lane -1 cannot be reached by driving against the roads.
    assert (against_a, against_b) == (-1, -1)


def test_a_program_is_the_same_bytes_each_time(tmp_path: Path) -> None:
    inner = _assign(_waypoint("a", -1, 20), _waypoint("b", -1, 30))
    first, second = _routed(tmp_path, inner), _routed(tmp_path, inner)
    assert msgspec.msgpack.encode(first) == msgspec.msgpack.encode(second)
