"""Which roads touch each end of a road, and which lanes lead there.

An end of road r has the number 2 r at its beginning and 2 r + 1 at its end. Ways that lead on from
an end stand together: one to the linked road, or one for each connection through the junction. A
junction's connections are told from the incoming road only; ways the other way through, for who
drives back, come from the links of the connecting roads and stand behind those.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from twin.road.opendrive.lane_graph import LaneGraph, LaneKey, incoming_end
from twin.road.opendrive.records import ContactPoint, Junction, RoadNetwork, RoadRecord
from twin.road.opendrive.road_frame import RoadFrame

STRAIGHT_M = 20.0
"""How far into a road that leads on from a direct junction its heading is asked [m]."""
WAY_COLUMNS = ("road", "contact", "told", "lane")
"""The road a way leads to; its end that is entered (0 beginning, 1 end); 1: the file tells it for
this direction; where its rows in ``lanes`` begin."""


@dataclass(frozen=True, slots=True)
class RoadWays:
    """Make it with :func:`road_ways`; W ways of R roads."""

    first: np.ndarray
    """Where the ways of each end begin, int32 [2 R + 1]."""
    ways: np.ndarray
    """int32 [W + 1, 4] (:data:`WAY_COLUMNS`)."""
    turns_rad: np.ndarray
    """How much the heading changes on the road of each way, at least 0, float64 [W]."""
    lanes: np.ndarray
    """Lanes that lead on: here, and there, int32 [K, 2]."""
    junctions: np.ndarray
    """By end of a road: number of the junction there, -1 where there is none, int32 [2 R]."""


@dataclass(frozen=True, slots=True)
class _Way:
    road: str
    contact: ContactPoint
    told: bool
    turn_rad: float
    lanes: tuple[tuple[int, int], ...]


def road_ways(network: RoadNetwork, frames: Sequence[RoadFrame], graph: LaneGraph) -> RoadWays:
    """The ways of all roads; ``frames`` in the order of the file, ``graph`` of its lanes."""
    first, ways, turns = [0], [], []
    lanes: list[tuple[int, int]] = []
    junctions = []
    numbers = {road_id: number for number, road_id in enumerate(network.roads)}
    junction_numbers = {name: number for number, name in enumerate(network.junctions)}
    ends = _Ends(network, {frame.road.id: frame for frame in frames}, graph)
    for road in network.roads.values():
        for end, link in (("start", road.predecessor), ("end", road.successor)):
            for way in ends.ways(road, "start" if end == "start" else "end"):
                contact = int(way.contact == "end")
                ways.append((numbers[way.road], contact, int(way.told), len(lanes)))
                turns.append(way.turn_rad)
                lanes += way.lanes
            first.append(len(ways))
            at_junction = link is not None and link.kind == "junction"
            junctions.append(junction_numbers[link.id] if link and at_junction else -1)
    return RoadWays(
        first=np.array(first, np.int32),
        ways=np.array([*ways, (-1, 0, 0, len(lanes))], np.int32),
        turns_rad=np.array(turns, float),
        lanes=np.array(lanes, np.int32).reshape(-1, 2),
        junctions=np.array(junctions, np.int32),
    )


def no_ways() -> RoadWays:
    """Ways of a network without roads."""
    return RoadWays(
        first=np.zeros(1, np.int32),
        ways=np.zeros((1, len(WAY_COLUMNS)), np.int32),
        turns_rad=np.zeros(0),
        lanes=np.zeros((0, 2), np.int32),
        junctions=np.zeros(0, np.int32),
    )


class _Ends:
    """What touches the ends of roads."""

    def __init__(
        self, network: RoadNetwork, frames: dict[str, RoadFrame], graph: LaneGraph
    ) -> None:
        self._network = network
        self._frames = frames
        self._graph = graph
        self._told: dict[tuple[str, ContactPoint], list[_Way]] = {}
        self._back: dict[tuple[str, ContactPoint], list[_Way]] = {}
        for junction in network.junctions.values():
            for road_id, end, way in self._through(junction):
                self._told.setdefault((road_id, end), []).append(way)
        for road in network.roads.values():
            if road.junction is not None:
                for other, end, way in self._backwards(road):
                    self._back.setdefault((other, end), []).append(way)

    def ways(self, road: RoadRecord, end: ContactPoint) -> list[_Way]:
        """All ways on from an end of a road, in a fixed order; each other end once."""
        link = road.predecessor if end == "start" else road.successor
        direct = []
        if link is not None and link.contact is not None:
            direct.append(self._way(road.id, end, link.id, link.contact, told=True))
        behind = [*direct, *self._told.get((road.id, end), ()), *self._back.get((road.id, end), ())]
        kept: dict[tuple[str, ContactPoint], _Way] = {}
        for way in behind:
            kept.setdefault((way.road, way.contact), way)
        return list(kept.values())

    def _through(self, junction: Junction) -> Iterator[tuple[str, ContactPoint, _Way]]:
        roads = self._network.roads
        for connection in junction.connections:
            incoming, connecting = (
                roads[connection.incoming_road],
                roads[connection.connecting_road],
            )
            end = incoming_end(incoming, connecting, junction, connection.contact)
            if end is not None:
                way = self._way(incoming.id, end, connecting.id, connection.contact, told=True)
                yield incoming.id, end, way

    def _backwards(self, road: RoadRecord) -> Iterator[tuple[str, ContactPoint, _Way]]:
        """Ways into a connecting road at the ends that it names itself."""
        for contact, link in (("start", road.predecessor), ("end", road.successor)):
            if link is None or link.contact is None:
                continue
            other = self._network.roads[link.id]
            there = other.predecessor if link.contact == "start" else other.successor
            if there is not None and there.kind == "junction" and there.id == road.junction:
                entered: ContactPoint = "start" if contact == "start" else "end"
                yield (
                    other.id,
                    link.contact,
                    self._way(other.id, link.contact, road.id, entered, told=False),
                )

    def _way(
        self, road: str, end: ContactPoint, to: str, contact: ContactPoint, *, told: bool
    ) -> _Way:
        here, there = self._network.roads[road], self._network.roads[to]
        index = 0 if end == "start" else len(here.sections) - 1
        pairs = []
        for lane in here.sections[index].lanes:
            named = lane.predecessors if end == "start" else lane.successors
            touching = [
                key.lane
                for key, point in self._graph.joints.get((LaneKey(road, index, lane.id), end), ())
                if key.road == to and point == contact
            ]
            first = [target for target in named if target in touching]
            pairs += [(lane.id, target) for target in dict.fromkeys([*first, *touching])]
        return _Way(to, contact, told, self._turn(there, contact), tuple(pairs))

    def _turn(self, road: RoadRecord, contact: ContactPoint) -> float:
        """Change of heading from the entered end on."""
        far = road.length_m if road.junction is not None else min(STRAIGHT_M, road.length_m)
        line = self._frames[road.id].line
        begin = 0.0 if contact == "start" else road.length_m
        stop = far if contact == "start" else road.length_m - far
        turn = float(line.at(stop).heading_rad) - float(line.at(begin).heading_rad)
        return abs(math.remainder(turn, 2.0 * math.pi))
