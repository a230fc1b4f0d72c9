"""What the types of a road network cannot say: whether it can be built, whoever made it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

from schemas.escape import escape
from twin.road.opendrive.furniture import copies_of
from twin.road.opendrive.reading.node import NUMBER_MAX
from twin.road.opendrive.reading.read_cubics import lowest
from twin.road.opendrive.reading.read_furniture import CORNERS_MAX, REPEATS_MAX
from twin.road.opendrive.reading.read_lanes import FRICTION_MAX, WIDTH_NEGATIVE_M
from twin.road.opendrive.reading.read_road import (
    COVER_M,
    CURVATURE_MAX_PER_M,
    ROAD_LENGTH_MAX_M,
    TILT_MAX_RAD,
    TURN_MAX_RAD,
)
from twin.road.opendrive.reading.reader import NETWORK_LENGTH_MAX_M, ROADS_MAX
from twin.road.opendrive.records import (
    Cubic,
    Junction,
    Lane,
    LaneSection,
    RoadLink,
    RoadNetwork,
    RoadRecord,
)

MISTAKES_MAX = 100
"""Mistakes of one network that are told."""
_START_M = 1e-6
"""Where the first record of a lane may begin at the latest."""


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
    if not 0.0 < road.length_m <= ROAD_LENGTH_MAX_M or not road.geometry or not road.sections:
        yield "it has no geometry, no lanes, or a length that no road has"
        return
    for name, records in (
        ("elevation", road.elevation),
        ("superelevation", road.superelevation),
        ("lane offset", road.lane_offset),
        ("types", road.types),
    ):
        if not _ascending(records):
            yield f"its {name} do not ascend"
    yield from _reference_line(road)
    yield from _tilt(road)
    yield from _sections(road)
    yield from _furniture(road)
    for link in (road.predecessor, road.successor):
        if link is not None:
            yield from _link(network, link)
    if road.junction is not None and road.junction not in network.junctions:
        yield "it leads through a junction that does not exist"
    yield from _lane_links(network, road)


def _furniture(road: RoadRecord) -> Iterator[str]:
    """What stands beside it."""
    rows = [row for item in road.objects for row in item.repeats]
    stations = [*(item.s_m for item in road.objects), *(item.s_m for item in road.signals)]
    stations += [s for row in rows for s in (row.s_m, row.s_m + row.length_m)]
    if not all(0.0 <= s <= road.length_m + COVER_M for s in stations):
        yield "an object or signal does not stand along it"
    sizes: list[float] = [value for row in rows for pair in row.size_m for value in pair]
    sizes += [v for row in rows for v in (*row.radius_m, row.length_m, row.distance_m)]
    for thing in road.objects:
        sizes += [thing.length_m, thing.width_m, thing.height_m, thing.radius_m]
    sizes += [value for sign in road.signals for value in (sign.width_m, sign.height_m)]
    if min(sizes, default=0.0) < 0.0:
        yield "an object or signal is smaller than nothing"
    spaced = [row for row in rows if row.distance_m > 0.0]
    # The first comparison keeps quotients finite.
    if any(
        row.length_m > REPEATS_MAX * row.distance_m or copies_of(row) > REPEATS_MAX
        for row in spaced
    ):
        yield "a row has more objects than are read"
    corners = [len(outline.corners) for item in road.objects for outline in item.outlines]
    if max(corners, default=0) > CORNERS_MAX:
        yield "an outline has more corners than are read"


def _reference_line(road: RoadRecord) -> Iterator[str]:
    reached, before = 0.0, -1.0
    for piece in road.geometry:
        if piece.start_m <= before or abs(piece.start_m - reached) > len(road.geometry) * COVER_M:
            yield "pieces of its reference line do not follow one another"
        if piece.length_m <= 0.0 or (piece.p_max is not None and piece.p_max <= 0.0):
            yield "a piece of its reference line has no length"
        tightest = max(map(abs, piece.curvature))
        if tightest > CURVATURE_MAX_PER_M or tightest * piece.length_m > TURN_MAX_RAD:
            yield "a piece of its reference line turns more than can be read"
        before, reached = piece.start_m, piece.start_m + piece.length_m
    if abs(reached - road.length_m) > len(road.geometry) * COVER_M:
        yield "its reference line is not as long as it"


def _tilt(road: RoadRecord) -> Iterator[str]:
    for cubic, reach in _reaches(road.superelevation, road.length_m):
        down = Cubic(cubic.start_m, -cubic.a, -cubic.b, -cubic.c, -cubic.d)
        if max(-lowest(cubic, 0.0, reach), -lowest(down, 0.0, reach)) > TILT_MAX_RAD:
            yield "it tilts more than can be read"


def _reaches(cubics: tuple[Cubic, ...], length_m: float) -> Iterator[tuple[Cubic, float]]:
    """Each polynomial and how far it holds."""
    ends = [*(cubic.start_m for cubic in cubics[1:]), length_m]
    for cubic, end in zip(cubics, ends, strict=False):
        yield cubic, max(min(end, length_m) - cubic.start_m, 0.0)


def _sections(road: RoadRecord) -> Iterator[str]:
    starts = [section.start_m for section in road.sections]
    ends = [section.end_m for section in road.sections]
    if starts[0] != 0.0 or [*starts[1:], road.length_m] != ends:
        yield "its lane sections do not follow one another"
    if any(start >= end for start, end in zip(starts, ends, strict=True)):
        yield "a lane section has no length"
    for section in road.sections:
        for lanes, sign in ((section.left, 1), ((section.center,), 0), (section.right, -1)):
            for index, lane in enumerate(lanes):
                if lane.id != sign * (index + 1):
                    yield f"lane {lane.id} stands where lane {sign * (index + 1)} belongs"
                yield from _lane(lane, section.end_m - section.start_m)


def _lane(lane: Lane, length_m: float) -> Iterator[str]:
    for records in (lane.widths, lane.borders, lane.marks, lane.materials, lane.speeds):
        if not _ascending(records):
            yield f"records of lane {lane.id} do not ascend"
    if not _ascending(lane.heights):
        yield f"heights of lane {lane.id} do not ascend"
    if not all(0.0 <= material.friction <= FRICTION_MAX for material in lane.materials):
        yield f"lane {lane.id} has a friction that no road has"
    if lane.id != 0 and not (lane.widths or lane.borders):
        yield f"lane {lane.id} has neither width nor border"
    for cubics in (lane.widths, lane.borders):
        if cubics and not 0.0 <= cubics[0].start_m <= _START_M:
            yield f"width or border of lane {lane.id} does not begin with it"
    for cubic, reach in _reaches(lane.widths, length_m):
        if lowest(cubic, 0.0, reach) < -2.0 * WIDTH_NEGATIVE_M:
            yield f"lane {lane.id} is less than 0 m wide"


def _lane_links(network: RoadNetwork, road: RoadRecord) -> Iterator[str]:
    """Lanes that lanes lead to exist."""
    pairs = list(itertools.pairwise(road.sections))
    for one, other in pairs:
        yield from _targets(one.lanes, other, "successors")
        yield from _targets(other.lanes, one, "predecessors")
    for link, section, name in (
        (road.predecessor, road.sections[0], "predecessors"),
        (road.successor, road.sections[-1], "successors"),
    ):
        there = network.roads.get(link.id) if link is not None and link.kind == "road" else None
        if link is not None and there is not None and there.sections:
            end = 0 if link.contact == "start" else -1
            yield from _targets(section.lanes, there.sections[end], name)


def _targets(lanes: tuple[Lane, ...], there: LaneSection, name: str) -> Iterator[str]:
    for lane in lanes:
        for target in getattr(lane, name):
            if target != 0 and there.lane(target) is None:
                yield f"lane {lane.id} leads to lane {target}, which does not exist there"


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
