"""A road network from the bytes of an OpenDRIVE file."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import NoReturn

from schemas.escape import escape
from twin.base.xml_file import parse_xml
from twin.road.opendrive.reading.node import Node, Notes
from twin.road.opendrive.reading.read_junction import read_junction
from twin.road.opendrive.reading.read_road import read_road
from twin.road.opendrive.records import Junction, Lane, RoadLink, RoadNetwork, RoadRecord

VERSIONS = ((1, 4), (1, 5), (1, 6), (1, 7), (1, 8))
"""Versions that are read."""
FILE_BYTES_MAX = 64 << 20
"""Largest file [bytes]."""
ELEMENTS_MAX = 1_000_000
"""Most elements of a file."""
DEPTH_MAX = 32
"""Deepest nesting; OpenDRIVE itself needs about ten."""
ROADS_MAX = 50_000
"""Most roads of a file."""
NETWORK_LENGTH_MAX_M = 1e7
"""Longest that all roads of a file may be together [m]."""
_ROOT = "OpenDRIVE"


def read_network(data: bytes, name: str) -> RoadNetwork:
    """The roads and junctions of an OpenDRIVE file.

    Args:
        data: its content.
        name: for messages.

    Raises:
        ValueError: it cannot be used; one line with file, line and element.
    """
    notes = Notes([])
    root = parse_xml(
        data,
        name,
        root=_ROOT,
        bytes_max=FILE_BYTES_MAX,
        depth_max=DEPTH_MAX,
        elements_max=ELEMENTS_MAX,
    )
    top = Node(root, _ROOT, "", name, "", notes)
    header = next((child for child in root if _is(child, "header")), None)
    if header is None:
        top.refuse("<header> is missing")
    head = Node(header, "header", _ROOT, name, "", notes)
    version = head.whole("revMajor"), head.whole("revMinor")
    if version not in VERSIONS:
        head.refuse(f"version {version[0]}.{version[1]}; 1.4 to 1.8 are read")
    roads: dict[str, RoadRecord] = {}
    junctions: dict[str, Junction] = {}
    controllers: dict[str, tuple[str, ...]] = {}
    nodes: dict[tuple[str, str], Node] = {}
    for node in top.children():
        if node.name == "header":
            continue
        key = node.name, node.text("id")
        if key in nodes:
            node.refuse(f"id={key[1][:40]!r} a second time, after line {nodes[key].line}")
        nodes[key] = node
        if node.name == "junction":
            junctions[key[1]] = read_junction(node, key[1])
            continue
        if node.name == "controller":
            controllers[key[1]] = tuple(child.text("signalId", "") for child in node.children())
            continue
        if len(roads) == ROADS_MAX:
            node.refuse(f"more than {ROADS_MAX} roads")
        roads[key[1]] = read_road(node, key[1])
    if not roads:
        top.refuse("no <road>")
    total = sum(road.length_m for road in roads.values())
    if total > NETWORK_LENGTH_MAX_M:
        top.refuse(f"{total:g} m of roads; at most {NETWORK_LENGTH_MAX_M:g} m are read")
    geo, offset = _reference(head)
    title = head.text("name", "")
    network = RoadNetwork(name, version, title, geo, offset, roads, junctions, (), controllers)
    _check_links(network, nodes)
    further = [f"{name}: {notes.further} more were left out"] if notes.further else []
    return replace(network, notes=(*notes.lines, *further))


def _is(element: object, name: str) -> bool:
    tag = getattr(element, "tag", None)
    return isinstance(tag, str) and tag.rpartition("}")[2] == name


def _reference(head: Node) -> tuple[str, tuple[float, float, float, float] | None]:
    geo, offset = "", None
    for child in head.children():
        if child.name == "geoReference":
            geo = (child.element.text or "").strip()[:4000]
        else:
            offset = (
                child.number("x"),
                child.number("y"),
                child.number("z", 0.0),
                child.number("hdg", 0.0),
            )
    return geo, offset


def _check_links(network: RoadNetwork, nodes: dict[tuple[str, str], Node]) -> None:
    """Whatever is named must be there."""
    for road in network.roads.values():
        node = nodes["road", road.id]
        for name in ("predecessor", "successor"):
            link: RoadLink | None = getattr(road, name)
            if link is None:
                continue
            known = network.roads if link.kind == "road" else network.junctions
            if link.id not in known:
                _refuse(node, link.line, name, f"{link.kind} {link.id[:40]} does not exist")
        if road.junction is not None and road.junction not in network.junctions:
            node.refuse(f"junction {road.junction[:40]} does not exist")
        _check_lane_links(network, road, node)
    for junction in network.junctions.values():
        _check_junction(network, junction, nodes["junction", junction.id])


def _check_lane_links(network: RoadNetwork, road: RoadRecord, node: Node) -> None:
    """Lanes that lanes lead to."""
    for one, other in itertools.pairwise(road.sections):
        for lane in one.lanes:
            _check_targets(node, lane, lane.successors, {i.id for i in other.lanes}, "successor")
        for lane in other.lanes:
            _check_targets(node, lane, lane.predecessors, {i.id for i in one.lanes}, "predecessor")
    for name, link, section in (
        ("predecessor", road.predecessor, road.sections[0]),
        ("successor", road.successor, road.sections[-1]),
    ):
        if link is None or link.kind != "road":
            continue
        there = network.roads[link.id].sections[0 if link.contact == "start" else -1]
        for lane in section.lanes:
            targets = lane.predecessors if name == "predecessor" else lane.successors
            _check_targets(node, lane, targets, {i.id for i in there.lanes}, name)


def _check_targets(
    node: Node, lane: Lane, targets: tuple[int, ...], there: set[int], name: str
) -> None:
    for target in targets:
        if target not in there and target != 0:
            _refuse(
                node,
                lane.line,
                "lane",
                f"lane {lane.id}: {name} lane {target} does not exist there",
            )


def _check_junction(network: RoadNetwork, junction: Junction, node: Node) -> None:
    for connection in junction.connections:
        for road in (connection.incoming_road, connection.connecting_road):
            if road not in network.roads:
                _refuse(node, connection.line, "connection", f"road {road[:40]} does not exist")
        sections = network.roads[connection.connecting_road].sections
        entered = sections[0 if connection.contact == "start" else -1]
        for _, lane in connection.lane_links:
            if lane != 0 and entered.lane(lane) is None:
                words = f"road {connection.connecting_road[:40]} has no lane {lane} there"
                line = _placed(node, connection.line, "connection", f"left out: {words}")
                node.notes.add(line)


def _refuse(node: Node, line: int, name: str, words: str) -> NoReturn:
    raise ValueError(_placed(node, line, name, words))


def _placed(node: Node, line: int, name: str, words: str) -> str:
    """As an element inside of ``node`` would say it."""
    text = node.message(words)
    head = f"{node.file}:{node.line}: <{node.name}>"
    place = f" of {node.name} {node.element.get('id', '')[:40]}"
    return escape(f"{node.file}:{line}: <{name}>{place}{text[len(head) :]}", 600)
