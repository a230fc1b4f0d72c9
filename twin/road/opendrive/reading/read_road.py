"""Reading of a road but for its lanes: links, reference line, profiles."""

from __future__ import annotations

import itertools

from twin.road.opendrive.reading.node import Node
from twin.road.opendrive.reading.read_cubics import lowest, read_cubics
from twin.road.opendrive.reading.read_furniture import read_objects, read_signals
from twin.road.opendrive.reading.read_lanes import read_lanes, read_speed
from twin.road.opendrive.records import (
    Cubic,
    GeometryKind,
    GeometryRecord,
    RoadLink,
    RoadRecord,
    RoadType,
)

ROAD_LENGTH_MAX_M = 1e6
"""Longest road [m]."""
COVER_M = 0.01
"""How far pieces may overlap, leave a gap, or end before the road does, by their stations [m]."""
TURN_MAX_RAD = 1000.0
"""Most that a piece may turn [rad]."""
CURVATURE_MAX_PER_M = 100.0
"""Tightest curve: 1 cm [1/m]."""
TILT_MAX_RAD = 1.0
"""Steepest superelevation [rad]."""

_P_RANGES = ("arcLength", "normalized")


def read_road(node: Node, road_id: str) -> RoadRecord:
    """A ``road`` element.

    Raises:
        ValueError: it cannot be used; one line with file, line and element.
    """
    where = f"road {road_id[:40]}"
    length = node.number("length", low=0.0)
    if not 0.0 < length <= ROAD_LENGTH_MAX_M:
        node.refuse(f"length={length:g}; above 0 and up to {ROAD_LENGTH_MAX_M:g} m is needed")
    parts: dict[str, Node] = {}
    types = []
    for child in node.children(where):
        if child.name == "type":
            types.append(_road_type(child))
        elif child.name in parts:
            child.refuse(f"a second one, after line {parts[child.name].line}")
        else:
            parts[child.name] = child
    for needed in ("planView", "lanes"):
        if needed not in parts:
            node.refuse(f"<{needed}> is missing")
    links = {n.name: _link(n) for n in (parts["link"].children() if "link" in parts else ())}
    if "surface" in parts:
        list(parts["surface"].children())
    junction = node.text("junction", "-1")
    lane_offset, sections = read_lanes(parts["lanes"], length)
    return RoadRecord(
        id=road_id,
        name=node.text("name", ""),
        length_m=length,
        rule="LHT" if node.choice("rule", ("RHT", "LHT"), "RHT") == "LHT" else "RHT",
        junction=None if junction == "-1" else junction,
        predecessor=links.get("predecessor"),
        successor=links.get("successor"),
        types=tuple(types),
        geometry=_plan_view(parts["planView"], length),
        elevation=_profile(parts.get("elevationProfile")),
        superelevation=_superelevation(parts.get("lateralProfile"), length),
        lane_offset=lane_offset,
        sections=sections,
        objects=read_objects(parts["objects"], length) if "objects" in parts else (),
        signals=read_signals(parts["signals"], length) if "signals" in parts else (),
        line=node.line,
    )


def _profile(node: Node | None) -> tuple[Cubic, ...]:
    return read_cubics(list(node.children())) if node else ()


def _superelevation(node: Node | None, length_m: float) -> tuple[Cubic, ...]:
    nodes = list(node.children()) if node else []
    cubics = read_cubics(nodes)
    for index, (child, cubic) in enumerate(zip(nodes, cubics, strict=True)):
        end = cubics[index + 1].start_m if index + 1 < len(cubics) else length_m
        reach = max(min(end, length_m) - cubic.start_m, 0.0)
        down = Cubic(cubic.start_m, -cubic.a, -cubic.b, -cubic.c, -cubic.d)
        steepest = max(-lowest(cubic, 0.0, reach), -lowest(down, 0.0, reach))
        if steepest > TILT_MAX_RAD:
            child.refuse(
                f"{steepest:.3g} rad somewhere along it; at most {TILT_MAX_RAD:g} are read"
            )
    return cubics


def _road_type(node: Node) -> RoadType:
    speeds = [read_speed(child) for child in node.children()]
    return RoadType(
        node.number("s", low=0.0),
        node.text("type"),
        node.text("country", ""),
        speeds[0] if speeds else None,
    )


def _link(node: Node) -> RoadLink:
    kind = node.choice("elementType", ("road", "junction"))
    if node.element.get("elementS") is not None:
        node.refuse("elementS: links to the middle of a road (virtual junctions) are not supported")
    if kind == "junction":
        return RoadLink("junction", node.text("elementId"), None, node.line)
    contact = node.choice("contactPoint", ("start", "end"))
    return RoadLink(
        "road", node.text("elementId"), "start" if contact == "start" else "end", node.line
    )


def _plan_view(node: Node, length_m: float) -> tuple[GeometryRecord, ...]:
    nodes = list(node.children())
    records = [_geometry(child) for child in nodes]
    reached = 0.0
    for child, record in zip(nodes, records, strict=True):
        if abs(record.start_m - reached) > COVER_M:
            child.refuse(
                f"s={record.start_m:g}, but the pieces before it reach {reached:g} m; "
                "pieces must follow one another without a gap"
            )
        reached = record.start_m + record.length_m
    if abs(reached - length_m) > COVER_M:
        node.refuse(f"its pieces reach {reached:g} m, the road is {length_m:g} m long")
    kept = tuple(record for record in records if record.length_m > 0.0)
    for one, other in itertools.pairwise(kept):
        if other.start_m <= one.start_m:
            node.refuse(f"two pieces begin at s={other.start_m:g}")
    return kept


def _geometry(node: Node) -> GeometryRecord:
    length = node.number("length", low=0.0)
    shapes = list(node.children())
    if len(shapes) != 1:
        node.refuse(f"{len(shapes)} shapes; one is needed: line, arc, spiral, poly3 or paramPoly3")
    shape = shapes[0]
    curvature, flat = (0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
    u, v, p_max = flat, flat, None
    if shape.name == "arc":
        curvature = (shape.number("curvature"),) * 2
    elif shape.name == "spiral":
        curvature = shape.number("curvStart"), shape.number("curvEnd")
    elif shape.name == "poly3":
        u = (0.0, 1.0, 0.0, 0.0)
        a, b, c, d = (shape.number(letter) for letter in "abcd")
        v = a, b, c, d
    elif shape.name == "paramPoly3":
        numbers = [shape.number(f"{letter}{axis}") for axis in "UV" for letter in "abcd"]
        u = numbers[0], numbers[1], numbers[2], numbers[3]
        v = numbers[4], numbers[5], numbers[6], numbers[7]
        p_max = 1.0 if shape.choice("pRange", _P_RANGES, "normalized") == "normalized" else length
    tightest = max(map(abs, curvature))
    if tightest > CURVATURE_MAX_PER_M or tightest * length > TURN_MAX_RAD:
        shape.refuse(
            f"curvature {tightest:g} 1/m over {length:g} m; at most {CURVATURE_MAX_PER_M:g} 1/m "
            f"and {TURN_MAX_RAD:g} rad are read"
        )
    return GeometryRecord(
        start_m=node.number("s", low=0.0),
        length_m=length,
        x_m=node.number("x"),
        y_m=node.number("y"),
        heading_rad=node.number("hdg"),
        kind=_KINDS[shape.name],
        curvature=curvature,
        u=u,
        v=v,
        p_max=p_max,
        line=node.line,
    )


_KINDS: dict[str, GeometryKind] = {
    "line": "line",
    "arc": "arc",
    "spiral": "spiral",
    "poly3": "cubic",
    "paramPoly3": "cubic",
}
