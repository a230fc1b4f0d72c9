"""Routes: waypoints joined by the shortest ways along lanes."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

from twin.road.opendrive.lane_graph import LanePosition, WaysToPlace
from twin.road.opendrive.records import LANE_TYPES
from twin.scenario.storyboard.compile.context import Compilation, Handler, RefusalError, only_child
from twin.scenario.storyboard.openscenario.element import ScenarioElement
from twin.scenario.storyboard.program.actions import AcquirePositionAction, AssignRouteAction
from twin.scenario.storyboard.program.places import (
    FixedPosition,
    RelativePosition,
    RoadRoute,
    RouteLeg,
)


@dataclass(frozen=True, slots=True)
class RoutePath:
    """A route with the ids of its roads."""

    route: RoadRoute
    roads: tuple[str, ...]
    """Of each leg."""

    def at(self, element: ScenarioElement, path_s_m: float) -> tuple[str, float, bool]:
        """Road id and station after a way along the route, and whether it leads along s there."""
        rest = path_s_m
        for leg, road in zip(self.route.legs, self.roads, strict=True):
            length = abs(leg.to_s_m - leg.from_s_m)
            if 0.0 <= rest <= length:
                forward = leg.to_s_m >= leg.from_s_m
                return road, leg.from_s_m + (rest if forward else -rest), forward
            rest -= length
        end = path_s_m - rest
        raise RefusalError(element, f"pathS={path_s_m:g} m on a route of {end:g} m")


def _route(element: ScenarioElement, context: Compilation) -> RoutePath:
    waypoints = element.all("Waypoint")
    places = []
    for waypoint in waypoints:
        if waypoint.values["routeStrategy"] != "shortest":
            words = f"routeStrategy {waypoint.values['routeStrategy']} is not played; use shortest"
            raise RefusalError(waypoint, words)
        position = waypoint.first("Position")
        assert position is not None
        place = context.fixed(position)
        if place.road < 0 or place.lane == 0:
            raise RefusalError(waypoint, "a waypoint must lie on a lane")
        places.append(place)
    closed = bool(element.values["closed"])
    targets = [*places, places[0]] if closed else places
    context.road_map(element)
    legs: list[RouteLeg] = []
    for waypoint, (one, other) in zip(
        [*waypoints[1:], waypoints[0]], itertools.pairwise(targets), strict=False
    ):
        way = _way(context, _ways(context, other), one)
        if way is None:
            raise RefusalError(waypoint, "no lanes lead there from the waypoint before it")
        legs += way
    route = RoadRoute(element.label, closed, _joined(legs))
    ids = list(context.road_numbers)
    return RoutePath(route, tuple(ids[leg.road] for leg in route.legs))


def _ways(context: Compilation, goal: FixedPosition) -> WaysToPlace:
    assert context.graph is not None
    return context.graph.ways_to(_lane_position(context, goal), LANE_TYPES)


def _way(context: Compilation, ways: WaysToPlace, start: FixedPosition) -> list[RouteLeg] | None:
    """Legs from one place on a lane to another; None: there is no way."""
    way = ways.route_from(_lane_position(context, start))
    if way is None:
        return None
    return [
        RouteLeg(
            context.road_numbers[step.lane.key.road],
            float(step.from_s_m),
            float(step.to_s_m),
            step.lane.key.lane,
        )
        for step in way.steps
    ]


def _lane_position(context: Compilation, place: FixedPosition) -> LanePosition:
    road = next(itertools.islice(context.road_numbers, place.road, None))
    return LanePosition(road, place.lane, place.s_m)


def _joined(legs: list[RouteLeg]) -> tuple[RouteLeg, ...]:
    """Legs without empty ones; neighbours on one road and lane become one."""
    out: list[RouteLeg] = []
    for leg in legs:
        if leg.from_s_m == leg.to_s_m:
            continue
        before = out[-1] if out else None
        ahead = leg.to_s_m > leg.from_s_m
        if (
            before is not None
            and (before.road, before.lane, before.to_s_m) == (leg.road, leg.lane, leg.from_s_m)
            and (before.to_s_m > before.from_s_m) == ahead
        ):
            out[-1] = RouteLeg(leg.road, before.from_s_m, leg.to_s_m, leg.lane)
        else:
            out.append(leg)
    return tuple(out)


def _assign(element: ScenarioElement, context: Compilation) -> AssignRouteAction:
    path: RoutePath = context.compile(only_child(element))
    if not path.route.legs:
        raise RefusalError(element, "its route has no length")
    return AssignRouteAction(context.route(path.route))


def _acquire(element: ScenarioElement, context: Compilation) -> AcquirePositionAction:
    position_element = element.first("Position")
    assert position_element is not None
    position = context.position(position_element)
    if isinstance(position, RelativePosition):
        raise RefusalError(
            element, "a position relative to an entity is not acquired; give a fixed one"
        )
    if position.road < 0 or position.lane == 0:
        raise RefusalError(element, "the position lies on no lane")
    return AcquirePositionAction(position, _ways_to(context, position))


def _ways_to(context: Compilation, goal: FixedPosition) -> tuple[int, ...]:
    """Routes to a place from the beginning of every road along it, and from its end against it."""
    assert context.roads is not None
    to_goal = _ways(context, goal)
    routes = []
    for number, frame in enumerate(context.roads.frames.values()):
        road = frame.road
        for sign, s_m, section in (
            (1.0, 0.0, road.sections[0]),
            (-1.0, road.length_m, road.sections[-1]),
        ):
            ways = []
            for lane in section.lanes:
                start = FixedPosition(0, 0, 0, 0, road=number, s_m=s_m, lane=lane.id)
                way = _way(context, to_goal, start)
                if way and sign * (way[0].to_s_m - way[0].from_s_m) > 0.0:
                    ways.append(way)
            best = min(ways, key=_length, default=None)
            routes.append(
                -1 if best is None else context.route(RoadRoute("", False, _joined(best)))
            )
    return tuple(routes)


def _length(way: list[RouteLeg]) -> float:
    return sum(abs(leg.to_s_m - leg.from_s_m) for leg in way)


ROUTES: dict[str, Handler] = {
    "Route": _route,
    "AssignRouteAction": _assign,
    "AcquirePositionAction": _acquire,
}
"""Handlers of routes by element type."""
