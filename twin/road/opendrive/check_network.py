"""What the types of a road network cannot say: whether it can be built, whoever made it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

from schemas.escape import escape
from twin.road.opendrive.reading.node import NUMBER_MAX
from twin.road.opendrive.reading.reader import NETWORK_LENGTH_MAX_M, ROADS_MAX
from twin.road.opendrive.records import (
    GeometryRecord,
    Junction,
    LaneSection,
    RoadLink,
    RoadNetwork,
    RoadRecord,
)

MISTAKES_MAX = 100
"""Mistakes of one network that are told."""


def network_mistakes(network: RoadNetwork) -> list[str]:
    """Why a network that somebody else has made cannot be used, a line each; empty: it can."""
    return list(itertools.islice(_mistakes(network), MISTAKES_MAX))


def _mistakes(network: RoadNetwork) -> Iterator[str]:
    if not 0 < len(network.roads) <= ROADS_MAX:
        yield f"{len(network.roads)} roads; 1 to {ROADS_MAX} are used"
        return
    if not math.fsum(road.length_m for road in network.roads.values()) <= NETWORK_LENGTH_MAX_M:
        yield f"roads are longer than {NETWORK_LENGTH_MAX_M:g} m together"
    for key, road in network.roads.items():
        place = f"road {escape(key, 40)}"
        if key != road.id:
            yield f"{place} is called {escape(road.id, 40)} elsewhere"
        if not is_bounded(road):
            yield f"{place}: a number is not between -{NUMBER_MAX:g} and {NUMBER_MAX:g}"
        else:
            yield from (f"{place}: {words}" for words in _road(network, road))
    for key, junction in network.junctions.items():
        place = f"junction {escape(key, 40)}"
        yield from (f"{place}: {words}" for words in _junction(network, junction))


def is_bounded(value: Any) -> bool:
    """Whether all numbers in records, lists and tables are finite and of a magnitude that reading
    allows."""
    if isinstance(value, float):
        return abs(value) <= NUMBER_MAX
    if isinstance(value, int):
        return abs(value) <= NUMBER_MAX
    if isinstance(value, tuple | list):
        return all(map(is_bounded, value))
    if is_dataclass(value):
        return all(is_bounded(getattr(value, item.name)) for item in fields(value))
    return True


def _road(network: RoadNetwork, road: RoadRecord) -> Iterator[str]:
    if road.length_m < 0.0 or not road.geometry or not road.sections:
        yield "it has no length, no geometry or no lanes"
        return
    for name, records in (
        ("geometry", road.geometry),
        ("lane sections", road.sections),
        ("elevation", road.elevation),
        ("superelevation", road.superelevation),
        ("lane offset", road.lane_offset),
        ("types", road.types),
    ):
        if not _ascending(records):
            yield f"its {name} do not ascend"
    for piece in road.geometry:
        yield from _geometry(piece)
    for section in road.sections:
        yield from _section(section)
    for link in (road.predecessor, road.successor):
        if link is not None:
            yield from _link(network, link)
    if road.junction is not None and road.junction not in network.junctions:
        yield "it leads through a junction that does not exist"


def _geometry(piece: GeometryRecord) -> Iterator[str]:
    if piece.length_m < 0.0:
        yield "a piece of its reference line has a negative length"
    if piece.p_max is not None and piece.p_max <= 0.0:
        yield "the range of a cubic is not above 0"


def _section(section: LaneSection) -> Iterator[str]:
    if section.end_m < section.start_m:
        yield "a lane section ends before it begins"
    sides = ((section.left, 1), ((section.center,), 0), (section.right, -1))
    for lanes, sign in sides:
        for index, lane in enumerate(lanes):
            if lane.id != sign * (index + 1):
                yield f"lane {lane.id} stands where lane {sign * (index + 1)} belongs"
            for records in (lane.widths, lane.borders, lane.marks, lane.materials, lane.speeds):
                if not _ascending(records):
                    yield f"records of lane {lane.id} do not ascend"


def _ascending(records: tuple[Any, ...]) -> bool:
    return all(a.start_m <= b.start_m for a, b in itertools.pairwise(records))


def _link(network: RoadNetwork, link: RoadLink) -> Iterator[str]:
    known = network.roads if link.kind == "road" else network.junctions
    if link.id not in known:
        yield f"it is linked to {link.kind} {escape(link.id, 40)}, which does not exist"
    elif link.kind == "road" and link.contact is None:
        yield f"it is linked to no end of road {escape(link.id, 40)}"


def _junction(network: RoadNetwork, junction: Junction) -> Iterator[str]:
    for connection in junction.connections:
        for road in (connection.incoming_road, connection.connecting_road):
            if road not in network.roads:
                yield f"it connects road {escape(road, 40)}, which does not exist"
