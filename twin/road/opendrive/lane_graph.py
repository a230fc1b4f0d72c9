"""The lanes of a network as a graph, and the shortest ways through it."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from twin.road.opendrive.records import (
    DRIVEN_TYPES,
    ContactPoint,
    Junction,
    Lane,
    LaneSection,
    RoadNetwork,
    RoadRecord,
)
from twin.road.opendrive.road_frame import traffic_sign


class LaneKey(NamedTuple):
    """A lane of a lane section."""

    road: str
    section: int
    """Number of the lane section, from 0."""
    lane: int


class DrivenLane(NamedTuple):
    """A lane, driven one way."""

    key: LaneKey
    sign: int
    """1 along s, -1 against it."""


class LanePosition(NamedTuple):
    """A place on a lane."""

    road: str
    lane: int
    s_m: float


class RouteStep(NamedTuple):
    """A stretch of a route on one lane."""

    lane: DrivenLane
    from_s_m: float
    to_s_m: float


@dataclass(frozen=True, slots=True)
class LaneRoute:
    """A way from one lane position to another."""

    steps: tuple[RouteStep, ...]
    length_m: float
    """Along the reference lines [m]."""


@dataclass(frozen=True, slots=True)
class LaneGraph:
    """Which lane leads to which; make it with :func:`lane_graph`."""

    network: RoadNetwork
    joints: dict[tuple[LaneKey, ContactPoint], tuple[tuple[LaneKey, ContactPoint], ...]]
    """What touches an end of a lane, in a fixed order."""

    def successors(self, driven: DrivenLane) -> tuple[DrivenLane, ...]:
        """The lanes that a driven lane leads to."""
        end: ContactPoint = "end" if driven.sign > 0 else "start"
        reached = []
        for key, contact in self.joints.get((driven.key, end), ()):
            sign = 1 if contact == "start" else -1
            if sign in self.signs(key):
                reached.append(DrivenLane(key, sign))
        return tuple(reached)

    def predecessors(self, driven: DrivenLane) -> tuple[DrivenLane, ...]:
        """The lanes that lead to a driven lane."""
        begin: ContactPoint = "start" if driven.sign > 0 else "end"
        before = []
        for key, contact in self.joints.get((driven.key, begin), ()):
            sign = 1 if contact == "end" else -1
            if sign in self.signs(key):
                before.append(DrivenLane(key, sign))
        return tuple(before)

    def signs(self, key: LaneKey) -> tuple[int, ...]:
        """The ways a lane may be driven."""
        road = self.network.roads[key.road]
        lane = road.sections[key.section].lane(key.lane)
        assert lane is not None
        sign = traffic_sign(road, lane)
        return (1, -1) if sign == 0 else (sign,)

    def route(
        self,
        start: LanePosition,
        goal: LanePosition,
        types: frozenset[str] = DRIVEN_TYPES,
    ) -> LaneRoute | None:
        """The shortest way that follows lanes, without changing them; None: there is none.

        Of equally long ways the one with fewer, then with earlier lanes counts.

        Args:
            start, goal: where it begins and ends.
            types: lanes it may use.

        Raises:
            ValueError: a position lies on no lane.
        """
        return self.ways_to(goal, types).route_from(start)

    def ways_to(self, goal: LanePosition, types: frozenset[str] = DRIVEN_TYPES) -> WaysToPlace:
        """The shortest ways to a place: one search for all starts, backwards.

        Args:
            goal: where they end.
            types: lanes they may use.

        Raises:
            ValueError: the position lies on no lane.
        """
        last = self.key(goal)
        heap: list[_Way] = []
        for sign in self.signs(last):
            driven = DrivenLane(last, sign)
            heapq.heappush(heap, (abs(goal.s_m - self.begin(driven)), 1, (driven, ())))
        return WaysToPlace(self, goal, last, types, heap)

    def key(self, position: LanePosition) -> LaneKey:
        """The lane of a position; ValueError: there is none."""
        road = self.network.roads.get(position.road)
        if road is None:
            raise ValueError(f"road {position.road[:40]} does not exist")
        if not 0.0 <= position.s_m <= road.length_m:
            raise ValueError(
                f"s={position.s_m:g} m on road {road.id[:40]}, which is {road.length_m:g} m long"
            )
        starts = [section.start_m for section in road.sections]
        index = max(sum(start <= position.s_m for start in starts) - 1, 0)
        if road.sections[index].lane(position.lane) is None:
            raise ValueError(
                f"road {road.id[:40]} has no lane {position.lane} at s={position.s_m:g} m"
            )
        return LaneKey(road.id, index, position.lane)

    def lane(self, key: LaneKey) -> Lane:
        """The record of a lane."""
        lane = self.network.roads[key.road].sections[key.section].lane(key.lane)
        assert lane is not None
        return lane

    def begin(self, driven: DrivenLane) -> float:
        """Station at which a driven lane begins."""
        return self.end(DrivenLane(driven.key, -driven.sign))

    def end(self, driven: DrivenLane) -> float:
        """Station at which a driven lane ends."""
        section: LaneSection = self.network.roads[driven.key.road].sections[driven.key.section]
        return section.end_m if driven.sign > 0 else section.start_m


_Lanes = tuple[DrivenLane, "_Lanes"] | tuple[()]
"""A lane and those after it, shared by all ways that end alike."""
_Way = tuple[float, int, _Lanes]
"""Length [m], number of lanes and lanes: the order in which ways are preferred."""


@dataclass(slots=True)
class WaysToPlace:
    """The shortest ways to one place, searched as far as they are asked for; make it with
    :meth:`LaneGraph.ways_to`."""

    graph: LaneGraph
    goal: LanePosition
    last: LaneKey
    """The lane that the place lies on."""
    types: frozenset[str]
    heap: list[_Way]
    """Ways that were met and may not be the shortest of their first lanes."""
    ways: dict[DrivenLane, _Way] = field(default_factory=dict)
    """The shortest from the beginning of a lane."""

    def route_from(self, start: LanePosition) -> LaneRoute | None:
        """The shortest way from a place; its own lane may be of any type. None: there is none.

        Raises:
            ValueError: the position lies on no lane.
        """
        first = self.graph.key(start)
        nexts: list[tuple[float, DrivenLane, DrivenLane]] = []
        for sign in self.graph.signs(first):
            driven = DrivenLane(first, sign)
            if first == self.last and sign * (self.goal.s_m - start.s_m) >= 0.0:
                step = RouteStep(driven, start.s_m, self.goal.s_m)
                return LaneRoute((step,), abs(self.goal.s_m - start.s_m))
            to_end = abs(self.graph.end(driven) - start.s_m)
            nexts += [(to_end, driven, after) for after in self.graph.successors(driven)]
        nearest = min((to_end for to_end, *_ in nexts), default=0.0)
        best: _Way | None = None
        while nexts:
            for to_end, driven, after in nexts:
                if after in self.ways:
                    length, count, lanes = self.ways[after]
                    way: _Way = (to_end + length, count + 1, (driven, lanes))
                    best = way if best is None else min(best, way)
            nexts = [each for each in nexts if each[2] not in self.ways]
            if not self.heap or (best is not None and nearest + self.heap[0][0] > best[0]):
                break
            self._settle({after for *_, after in nexts})
        return None if best is None else self._as_route(best, start)

    def _settle(self, wanted: set[DrivenLane]) -> None:
        """Search on until the shortest way of one more of these lanes is known, or none is left."""
        graph, types = self.graph, self.types
        while self.heap:
            length, count, lanes = heapq.heappop(self.heap)
            assert lanes
            driven = lanes[0]
            if driven in self.ways or graph.lane(driven.key).type not in types:
                continue
            self.ways[driven] = (length, count, lanes)
            for before in graph.predecessors(driven):
                if before not in self.ways:
                    whole = abs(graph.end(before) - graph.begin(before))
                    heapq.heappush(self.heap, (whole + length, count + 1, (before, lanes)))
            if driven in wanted:
                return

    def _as_route(self, way: _Way, start: LanePosition) -> LaneRoute:
        length_m, _, lanes = way
        steps: list[RouteStep] = []
        while lanes:
            driven, lanes = lanes
            from_s = self.graph.begin(driven) if steps else start.s_m
            to_s = self.graph.end(driven) if lanes else self.goal.s_m
            steps.append(RouteStep(driven, from_s, to_s))
        return LaneRoute(tuple(steps), length_m)


_Joint = tuple[tuple[LaneKey, ContactPoint], tuple[LaneKey, ContactPoint]]


def lane_graph(network: RoadNetwork) -> LaneGraph:
    """The graph of all lanes: through lane sections, from road to road and through junctions."""
    joints: dict[tuple[LaneKey, ContactPoint], dict[tuple[LaneKey, ContactPoint], None]] = {}
    sources = itertools.chain(
        *(_inside(road) for road in network.roads.values()),
        *(_between(network, road) for road in network.roads.values()),
        *(_through(network, junction) for junction in network.junctions.values()),
    )
    for one, other in sources:
        if all(_exists(network, key) for key, _ in (one, other)):
            joints.setdefault(one, {})[other] = None
            joints.setdefault(other, {})[one] = None
    return LaneGraph(network, {end: tuple(sorted(others)) for end, others in joints.items()})


def _exists(network: RoadNetwork, key: LaneKey) -> bool:
    return network.roads[key.road].sections[key.section].lane(key.lane) is not None


def _inside(road: RoadRecord) -> Iterator[_Joint]:
    for index, (one, other) in enumerate(itertools.pairwise(road.sections)):
        for lane in one.lanes:
            for target in lane.successors:
                yield _joint(road.id, index, lane.id, "end", road.id, index + 1, target, "start")
        for lane in other.lanes:
            for target in lane.predecessors:
                yield _joint(road.id, index, target, "end", road.id, index + 1, lane.id, "start")


def _between(network: RoadNetwork, road: RoadRecord) -> Iterator[_Joint]:
    last = len(road.sections) - 1
    ends: tuple[tuple[ContactPoint, int], ...] = (("start", 0), ("end", last))
    for contact, index in ends:
        link = road.predecessor if contact == "start" else road.successor
        if link is None or link.contact is None:
            continue
        there = _outermost(network.roads[link.id], link.contact)
        for lane in road.sections[index].lanes:
            for target in lane.predecessors if contact == "start" else lane.successors:
                yield _joint(road.id, index, lane.id, contact, link.id, there, target, link.contact)


def _through(network: RoadNetwork, junction: Junction) -> Iterator[_Joint]:
    for connection in junction.connections:
        connecting = network.roads[connection.connecting_road]
        incoming = network.roads[connection.incoming_road]
        contact = incoming_end(incoming, connecting, junction, connection.contact)
        if contact is None:
            continue
        here, there = _outermost(incoming, contact), _outermost(connecting, connection.contact)
        for from_lane, to_lane in connection.lane_links:
            yield _joint(
                incoming.id,
                here,
                from_lane,
                contact,
                connecting.id,
                there,
                to_lane,
                connection.contact,
            )


def incoming_end(
    incoming: RoadRecord, connecting: RoadRecord, junction: Junction, contact: ContactPoint
) -> ContactPoint | None:
    """The end of the incoming road at the junction; the connecting road knows it best."""
    link = connecting.predecessor if contact == "start" else connecting.successor
    if link is not None and link.kind == "road" and link.id == incoming.id:
        return link.contact
    for end, own in (("end", incoming.successor), ("start", incoming.predecessor)):
        if own is not None and own.kind == "junction" and own.id == junction.id:
            return "end" if end == "end" else "start"
    return None


def _outermost(road: RoadRecord, contact: ContactPoint) -> int:
    return 0 if contact == "start" else len(road.sections) - 1


def _joint(
    road: str,
    section: int,
    lane: int,
    contact: ContactPoint,
    other_road: str,
    other_section: int,
    other_lane: int,
    other_contact: ContactPoint,
) -> _Joint:
    one = LaneKey(road, section, lane), contact
    return one, (LaneKey(other_road, other_section, other_lane), other_contact)
