"""Reading of lanes: sections, widths, marks."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Literal, Protocol, TypeVar

from twin.road.opendrive.reading.node import Node
from twin.road.opendrive.reading.read_cubics import lowest, read_cubics
from twin.road.opendrive.records import (
    LANE_TYPES,
    Cubic,
    Lane,
    LaneHeight,
    LaneMaterial,
    LaneSection,
    MarkLine,
    RoadMark,
    SpeedLimit,
)

FRICTION_MAX = 2.0
"""Highest friction of a lane that counts [-]."""
WIDTH_NEGATIVE_M = 1e-3
"""How far below zero a width may fall, by rounding in the file; it counts as zero [m]."""
_UNITS = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704}
_CHANGES = ("both", "decrease", "increase", "none")


def read_lanes(node: Node, length_m: float) -> tuple[tuple[Cubic, ...], tuple[LaneSection, ...]]:
    """Lane offset and lane sections of a road of ``length_m``.

    Raises:
        ValueError: they cannot be used; one line with file, line and element.
    """
    children = list(node.children())
    offset = read_cubics([child for child in children if child.name == "laneOffset"])
    nodes = [child for child in children if child.name == "laneSection"]
    if not nodes:
        node.refuse("<laneSection> is missing")
    starts = [child.number("s", low=0.0) for child in nodes]
    if starts[0] > 1e-6:
        nodes[0].refuse(f"s={starts[0]:g}; the first lane section begins at 0")
    starts[0] = 0.0
    for child, (before, start) in zip(nodes[1:], itertools.pairwise(starts), strict=True):
        if start <= before:
            child.refuse(f"s={start:g}, but the section before it begins at {before:g}")
        if start >= length_m:
            child.refuse(f"s={start:g}, but the road is {length_m:g} m long")
    ends = [*starts[1:], length_m]
    sections = [_section(*each) for each in zip(nodes, starts, ends, strict=True)]
    return offset, tuple(sections)


def read_speed(node: Node) -> float | None:
    """A ``speed`` element's limit, None: there is no limit [m/s]."""
    if node.text("max") in ("no limit", "undefined"):
        return None
    unit = node.choice("unit", _UNITS, "m/s")
    return node.number("max", low=0.0) * _UNITS[unit]


def _section(node: Node, start_m: float, end_m: float) -> LaneSection:
    if node.flag("singleSide"):
        node.refuse("singleSide: sections of one side are not supported; split both sides")
    sides: dict[str, list[Lane]] = {"left": [], "center": [], "right": []}
    lines: dict[str, int] = {}
    for side in node.children():
        if side.name in lines:
            side.refuse(f"a second one, after line {lines[side.name]}")
        lines[side.name] = side.line
        seen: dict[int, int] = {}
        for child in side.children():
            lane = _lane(child, side.name, end_m - start_m)
            if lane.id in seen:
                child.refuse(f"lane {lane.id} a second time, after line {seen[lane.id]}")
            seen[lane.id] = child.line
            sides[side.name].append(lane)
    left = _ordered(node, sides["left"], 1)
    right = _ordered(node, sides["right"], -1)
    if len(sides["center"]) != 1:
        node.refuse(f"{len(sides['center'])} centre lanes; one with id 0 is needed")
    return LaneSection(start_m, end_m, left, sides["center"][0], right, node.line)


def _ordered(node: Node, lanes: Sequence[Lane], sign: int) -> tuple[Lane, ...]:
    ordered = tuple(sorted(lanes, key=lambda lane: abs(lane.id)))
    ids = [lane.id for lane in ordered]
    if ids != [sign * (index + 1) for index in range(len(ids))]:
        words = ", ".join(str(i) for i in ids[:20])
        node.refuse(f"lane ids {words}; {sign}, {2 * sign}, ... without a gap are needed")
    return ordered


def _lane(node: Node, side: str, length_m: float) -> Lane:
    lane_id = node.whole("id")
    if (lane_id > 0) - (lane_id < 0) != {"left": 1, "center": 0, "right": -1}[side]:
        node.refuse(f"id={lane_id} in <{side}>; left lanes are above 0, right ones below, centre 0")
    parts: dict[str, list[Node]] = {}
    for child in node.children(f"{node.where} lane {lane_id}"):
        parts.setdefault(child.name, []).append(child)
    widths = read_cubics(parts.get("width", []), "sOffset")
    borders = () if widths else read_cubics(parts.get("border", []), "sOffset")
    if lane_id == 0:
        widths = borders = ()
    elif not (widths or borders):
        node.refuse(f"lane {lane_id} has neither <width> nor <border>")
    for cubics, name in ((widths, "width"), (borders, "border")):
        if cubics and cubics[0].start_m > 1e-6:
            parts[name][0].refuse("the first one must begin at sOffset=0")
    _check_widths(widths, parts.get("width", []), length_m)
    links = {"predecessor": (), "successor": ()} | _links(parts.get("link", []))
    return Lane(
        id=lane_id,
        type=node.choice("type", LANE_TYPES),
        level=node.flag("level"),
        direction=_DIRECTIONS[node.choice("direction", _DIRECTIONS, "standard")],
        widths=widths,
        borders=borders,
        predecessors=links["predecessor"],
        successors=links["successor"],
        marks=_in_order(parts.get("roadMark", []), _mark),
        materials=_in_order(parts.get("material", []), _material),
        speeds=_in_order(parts.get("speed", []), _speed),
        heights=_in_order(parts.get("height", []), _height),
        line=node.line,
    )


_DIRECTIONS: dict[str, Literal["standard", "reversed", "both"]] = {
    "standard": "standard",
    "reversed": "reversed",
    "both": "both",
}


def _check_widths(widths: Sequence[Cubic], nodes: Sequence[Node], length_m: float) -> None:
    for index, cubic in enumerate(widths):
        end = widths[index + 1].start_m if index + 1 < len(widths) else length_m
        reach = min(end, length_m) - cubic.start_m
        if reach > 0.0 and (width := lowest(cubic, 0.0, reach)) < -WIDTH_NEGATIVE_M:
            nodes[index].refuse(
                f"the lane is {width:.3g} m wide somewhere along it; 0 is the least"
            )


def _links(nodes: Sequence[Node]) -> dict[str, tuple[int, ...]]:
    links: dict[str, tuple[int, ...]] = {}
    for child in itertools.chain.from_iterable(node.children() for node in nodes):
        links[child.name] = (*links.get(child.name, ()), child.whole("id"))
    return links


class _Placed(Protocol):
    """A record that begins somewhere."""

    @property
    def start_m(self) -> float: ...


_Record = TypeVar("_Record", bound=_Placed)


def _in_order(nodes: Sequence[Node], read: Callable[[Node], _Record]) -> tuple[_Record, ...]:
    records: list[_Record] = []
    for node in nodes:
        record = read(node)
        if records and record.start_m < records[-1].start_m:
            node.refuse(f"sOffset={record.start_m:g} lies before that of the one before")
        records.append(record)
    return tuple(records)


def _mark(node: Node) -> RoadMark:
    types = list(node.children())
    width = node.number("width", 0.12, low=0.0)
    color = node.text("color", "standard")
    lines = tuple(_mark_line(line, width, color) for kind in types for line in kind.children())
    return RoadMark(
        start_m=node.number("sOffset", 0.0, low=0.0),
        type=node.text("type"),
        weight=node.text("weight", "standard"),
        color=color,
        width_m=width,
        lane_change=node.choice("laneChange", _CHANGES, "both"),
        height_m=node.number("height", 0.0, low=0.0),
        material=node.text("material", "standard"),
        lines=lines,
    )


def _mark_line(node: Node, width_m: float, color: str) -> MarkLine:
    return MarkLine(
        length_m=node.number("length", low=0.0),
        space_m=node.number("space", low=0.0),
        t_offset_m=node.number("tOffset"),
        s_offset_m=node.number("sOffset", low=0.0),
        width_m=node.number("width", width_m, low=0.0),
        color=node.text("color", color),
    )


def _material(node: Node) -> LaneMaterial:
    friction = node.number("friction", low=0.0)
    if friction > FRICTION_MAX:
        node.notes.add(node.message(f"friction={friction:g} counts as {FRICTION_MAX:g}"))
    return LaneMaterial(
        node.number("sOffset", low=0.0),
        min(friction, FRICTION_MAX),
        node.text("surface", ""),
        node.number("roughness", 0.0),
    )


def _speed(node: Node) -> SpeedLimit:
    return SpeedLimit(node.number("sOffset", low=0.0), read_speed(node))


def _height(node: Node) -> LaneHeight:
    return LaneHeight(
        node.number("sOffset", low=0.0), node.number("inner", 0.0), node.number("outer", 0.0)
    )
