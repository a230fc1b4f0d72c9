"""The elements of OpenDRIVE, and what becomes of each: the one table of what is supported.

The reader asks it about every element it meets, and :func:`as_markdown` prints it for people.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

Treatment = Literal["read", "ignored", "noted", "refused"]


class RoadElementRule(NamedTuple):
    """What becomes of an element."""

    treatment: Treatment
    """``read``: it has an effect. ``ignored``: it can have none here. ``noted``: left out, and said
    so, because somebody may miss it. ``refused``: the file would mean something else without it."""
    why: str = ""
    """What it is read as, or why it is not."""


def _read(why: str) -> RoadElementRule:
    return RoadElementRule("read", why)


def _noted(why: str) -> RoadElementRule:
    return RoadElementRule("noted", why)


def _refused(why: str) -> RoadElementRule:
    return RoadElementRule("refused", why)


_IGNORED = RoadElementRule("ignored", "says nothing about roads")

EVERYWHERE: dict[str, RoadElementRule] = {
    "userData": _IGNORED,
    "dataQuality": _IGNORED,
    "include": _refused("another file would have to be read; put its content in its place"),
}
"""Children that any element may have."""

CHILDREN: dict[str, dict[str, RoadElementRule]] = {
    "OpenDRIVE": {
        "header": _read("version, name, geographic reference"),
        "road": _read("roads"),
        "junction": _read("junctions"),
        "controller": _read("signals that a scenario switches together"),
        "junctionGroup": _IGNORED,
        "station": _noted("stops of trams and buses"),
    },
    "controller": {"control": _read("one of its signals")},
    "header": {
        "geoReference": _read("kept as text; coordinates stay those of the file"),
        "offset": _read("kept; coordinates stay those of the file"),
        "license": _IGNORED,
        "defaultRegulations": _noted("rules of signals"),
    },
    "road": {
        "link": _read("what comes before and after"),
        "type": _read("type and speed limit along s"),
        "planView": _read("the reference line"),
        "elevationProfile": _read("height along s"),
        "lateralProfile": _read("superelevation along s"),
        "lanes": _read("lanes"),
        "objects": _read("objects"),
        "signals": _read("signals"),
        "surface": _read("must be empty"),
        "railroad": _noted("switches of railways"),
    },
    "road/link": {
        "predecessor": _read("road or junction before the start"),
        "successor": _read("road or junction after the end"),
        "neighbor": _noted("neighbours of OpenDRIVE 1.4 take no part in the lane graph"),
    },
    "road/type": {"speed": _read("speed limit; km/h, mph or m/s")},
    "planView": {"geometry": _read("a piece of the reference line")},
    "geometry": {
        "line": _read("straight"),
        "arc": _read("constant curvature"),
        "spiral": _read("clothoid: curvature linear along s"),
        "poly3": _read("cubic v(u)"),
        "paramPoly3": _read("cubics u(p), v(p), both pRange"),
    },
    "elevationProfile": {"elevation": _read("cubic of s")},
    "lateralProfile": {
        "superelevation": _read("cubic of s"),
        "crossfall": _refused("crossfall of OpenDRIVE 1.4 bends the surface; use superelevation"),
        "shape": _refused("lateral shapes bend the surface"),
        "crossSectionSurface": _refused("cross section surfaces bend the surface"),
    },
    "lanes": {
        "laneOffset": _read("cubic of s"),
        "laneSection": _read("lane sections"),
    },
    "laneSection": {
        "left": _read("lanes with positive ids"),
        "center": _read("lane 0, of which the marks are read"),
        "right": _read("lanes with negative ids"),
    },
    "left": {"lane": _read("a lane")},
    "center": {"lane": _read("a lane")},
    "right": {"lane": _read("a lane")},
    "lane": {
        "link": _read("predecessor and successor lanes"),
        "width": _read("cubic of s"),
        "border": _read("cubic of s, where there is no width"),
        "roadMark": _read("marks on its outer border"),
        "material": _read("friction"),
        "speed": _read("speed limit; km/h, mph or m/s"),
        "height": _read("inner and outer height, constant up to the next"),
        "access": _noted("who may use a lane"),
        "rule": _noted("rules of a lane"),
        "visibility": _IGNORED,
    },
    "lane/link": {"predecessor": _read("a lane"), "successor": _read("a lane")},
    "roadMark": {
        "type": _read("its lines"),
        "sway": _refused("marks that leave the border of their lane"),
        "explicit": _refused("marks line by line; describe them by type"),
    },
    "roadMark/type": {"line": _read("length, space, tOffset, sOffset, width, color")},
    "objects": {
        "object": _read("boxes, cylinders and outlines"),
        "objectReference": _noted("objects of other roads"),
        "tunnel": _noted("tunnels"),
        "bridge": _noted("bridges"),
    },
    "object": {
        "outlines": _read("outlines"),
        "outline": _read("its outline (OpenDRIVE 1.4)"),
        "repeat": _read("rows, and bodies drawn along the road; sizes change linearly"),
        "material": _IGNORED,
        "validity": _noted("lanes that an object is for"),
        "parkingSpace": _noted("who may park; spaces are objects of type parkingSpace"),
        "markings": _noted(
            "markings of objects; parking spaces and crosswalks have those of their type"
        ),
        "borders": _noted("borders of objects"),
        "surface": _noted("surfaces of objects"),
        "skeleton": _noted("skeletons of objects"),
    },
    "outlines": {"outline": _read("its corners")},
    "outline": {
        "cornerRoad": _read("corner in s, t"),
        "cornerLocal": _read("corner in u, v"),
    },
    "signals": {
        "signal": _read("signals"),
        "signalReference": _noted("signals of other roads"),
    },
    "signal": {
        "validity": _noted("lanes that a signal is for"),
        "dependency": _noted("signals that depend on each other"),
        "reference": _noted("what a signal refers to"),
        "positionRoad": _noted("a signal stands where its s and t say"),
        "positionInertial": _noted("a signal stands where its s and t say"),
        "semantics": _noted("meanings of signals; country, type and subtype are read"),
        "staticBoard": _noted("signs on a board"),
        "vmsBoard": _noted("signs that change"),
        "vmsGroup": _noted("signs that change"),
    },
    "road/surface": {"CRG": _refused("surfaces of OpenCRG")},
    "junction": {
        "connection": _read("ways through it"),
        "priority": _read("which road goes first"),
        "controller": _noted("which controllers belong to a junction"),
        "surface": _refused("surfaces of OpenCRG"),
        "boundary": _noted("boundaries of junctions"),
        "elevationGrid": _refused("an elevation grid bends the surface"),
        "crossPath": _noted("paths that cross a junction"),
        "planView": _noted("reference lines of junctions"),
        "trafficIsland": _noted("traffic islands"),
        "objects": _noted("objects of junctions"),
        "signals": _noted("signals of junctions"),
    },
    "connection": {
        "laneLink": _read("from lane to lane"),
        "predecessor": _refused("virtual junctions"),
        "successor": _refused("virtual junctions"),
    },
}
"""Known children by the element they stand in; ``parent/element`` where the name alone says too
little. Elements that are not listed have none."""

OPAQUE = frozenset({"geoReference"})
"""Elements read as text."""


def rule_of(path: str, child: str) -> RoadElementRule | None:
    """What becomes of ``child`` in an element; None: OpenDRIVE 1.4 to 1.8 has no such thing.

    Args:
        path: the element's name with its parent's, ``parent/element``.
        child: the child's name.
    """
    table = CHILDREN.get(path, CHILDREN.get(path.rpartition("/")[2], {}))
    return table.get(child) or EVERYWHERE.get(child)


def as_markdown() -> str:
    """All of it as a Markdown table."""
    lines = ["| in | element | | |", "|---|---|---|---|"]
    for path, table in {**CHILDREN, "any element": EVERYWHERE}.items():
        for name, rule in table.items():
            lines.append(f"| `{path}` | `{name}` | {rule.treatment} | {rule.why} |")
    return "\n".join(lines).replace("`any element`", "any element") + "\n"
