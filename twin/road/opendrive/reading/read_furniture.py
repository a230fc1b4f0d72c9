"""Reading of objects and signals."""

from __future__ import annotations

from twin.road.opendrive.furniture import ObjectOutline, OutlineCorner, RoadObject, RoadSignal
from twin.road.opendrive.reading.node import Node

_ORIENTATIONS = ("+", "-", "none")


def read_objects(node: Node, length_m: float) -> tuple[RoadObject, ...]:
    """Objects of a road of ``length_m``; their ids are unique in it."""
    return tuple(_object(child, length_m) for child in node.children())


def read_signals(node: Node, length_m: float) -> tuple[RoadSignal, ...]:
    """Signals of a road of ``length_m``."""
    return tuple(_signal(child, length_m) for child in node.children())


def _station(node: Node, length_m: float) -> float:
    s = node.number("s", low=0.0)
    if s > length_m + 0.01:
        node.refuse(f"s={s:g}, but the road is {length_m:g} m long")
    return s


def _yes(node: Node, key: str) -> bool:
    return node.choice(key, ("yes", "no", "true", "false"), "no") in ("yes", "true")


def _object(node: Node, length_m: float) -> RoadObject:
    outlines = []
    for child in node.children():
        for outline in child.children() if child.name == "outlines" else (child,):
            corners = tuple(_corner(corner, length_m) for corner in outline.children())
            outlines.append(ObjectOutline(corners, outline.flag("closed", default=True)))
    return RoadObject(
        id=node.text("id"),
        name=node.text("name", ""),
        type=node.text("type", "none"),
        subtype=node.text("subtype", ""),
        s_m=_station(node, length_m),
        t_m=node.number("t"),
        z_offset_m=node.number("zOffset", 0.0),
        heading_rad=node.number("hdg", 0.0),
        pitch_rad=node.number("pitch", 0.0),
        roll_rad=node.number("roll", 0.0),
        length_m=node.number("length", 0.0, low=0.0),
        width_m=node.number("width", 0.0, low=0.0),
        height_m=node.number("height", 0.0, low=0.0),
        radius_m=node.number("radius", 0.0, low=0.0),
        orientation=node.choice("orientation", _ORIENTATIONS, "none"),
        dynamic=_yes(node, "dynamic"),
        outlines=tuple(outlines),
        line=node.line,
    )


def _corner(node: Node, length_m: float) -> OutlineCorner:
    if node.name == "cornerRoad":
        place = _station(node, length_m), node.number("t"), node.number("dz", 0.0)
        return OutlineCorner("road", place, node.number("height", 0.0))
    place = node.number("u"), node.number("v"), node.number("z", 0.0)
    return OutlineCorner("local", place, node.number("height", 0.0))


def _signal(node: Node, length_m: float) -> RoadSignal:
    list(node.children())
    return RoadSignal(
        id=node.text("id"),
        name=node.text("name", ""),
        s_m=_station(node, length_m),
        t_m=node.number("t"),
        z_offset_m=node.number("zOffset", 0.0),
        h_offset_rad=node.number("hOffset", 0.0),
        pitch_rad=node.number("pitch", 0.0),
        roll_rad=node.number("roll", 0.0),
        orientation=node.choice("orientation", _ORIENTATIONS, "none"),
        dynamic=_yes(node, "dynamic"),
        country=node.text("country", ""),
        type=node.text("type", "-1"),
        subtype=node.text("subtype", "-1"),
        value=None if node.element.get("value") is None else node.number("value"),
        unit=node.text("unit", ""),
        text=node.text("text", ""),
        width_m=node.number("width", 0.0, low=0.0),
        height_m=node.number("height", 0.0, low=0.0),
        line=node.line,
    )
