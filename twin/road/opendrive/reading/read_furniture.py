"""Reading of objects and signals."""

from __future__ import annotations

from twin.road.opendrive.furniture import (
    ObjectOutline,
    ObjectRepeat,
    OutlineCorner,
    RoadObject,
    RoadSignal,
    copies_of,
)
from twin.road.opendrive.reading.node import NUMBER_MAX, Node

REPEATS_MAX = 10_000
"""Most copies of an object in one row."""
CORNERS_MAX = 200
"""Most corners of an outline."""
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
    outlines, repeats = [], []
    for child in node.children():
        if child.name == "repeat":
            repeats.append(_repeat(child, node, length_m))
            continue
        for outline in child.children() if child.name == "outlines" else (child,):
            corners = tuple(_corner(corner, length_m) for corner in outline.children())
            if len(corners) > CORNERS_MAX:
                outline.refuse(f"{len(corners)} corners; at most {CORNERS_MAX} are read")
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
        repeats=tuple(repeats),
        line=node.line,
    )


def _repeat(node: Node, parent: Node, length_m: float) -> ObjectRepeat:
    """A row; what it does not say is as the object ``parent`` has it."""
    s = _station(node, length_m)
    way = node.number("length", low=0.0)
    if s + way > length_m + 0.01:
        node.notes.add(node.message(f"it ends at s={s + way:g}; the road is {length_m:g} m long"))
    way = max(min(way, length_m - s), 0.0)
    distance = node.number("distance", low=0.0)
    row = ObjectRepeat(
        s_m=s,
        length_m=way,
        distance_m=distance,
        t_m=_change(node, "t", parent.number("t")),
        z_offset_m=_change(node, "zOffset", parent.number("zOffset", 0.0)),
        size_m=(
            _size(node, parent, "length"),
            _size(node, parent, "width"),
            _size(node, parent, "height"),
        ),
        radius_m=_size(node, parent, "radius"),
        line=node.line,
    )
    # The quotient of numbers that are read is finite, but may be larger than any count.
    if distance > 0.0 and (way / distance > REPEATS_MAX or copies_of(row) > REPEATS_MAX):
        node.refuse(f"{way / distance + 1:.0f} objects in a row; at most {REPEATS_MAX} are read")
    return row


def _size(node: Node, parent: Node, name: str) -> tuple[float, float]:
    return _change(node, name, parent.number(name, 0.0, low=0.0), 0.0)


def _change(node: Node, name: str, usual: float, low: float = -NUMBER_MAX) -> tuple[float, float]:
    """A value at the beginning and the end of a row; ``usual`` where nothing is said."""
    begin = node.number(f"{name}Start", usual, low=low)
    return begin, node.number(f"{name}End", begin, low=low)


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
