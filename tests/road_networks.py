"""Made-up road networks for tests of tables and of what walks on them."""

from __future__ import annotations

import math

from road_files import LINE, WIDTH, end, geometry, lane, link, road, section, xodr

from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.records import RoadNetwork

SHAPES = {
    "line": (80.0, LINE),
    "left arc": (60.0, f'<arc curvature="{1 / 15!r}"/>'),
    "right arc": (300.0, '<arc curvature="-0.004"/>'),
    "spiral": (70.0, '<spiral curvStart="0.05" curvEnd="-0.06"/>'),
    "tight spiral": (20.0, '<spiral curvStart="0" curvEnd="0.3"/>'),
    "poly3": (40.0, '<poly3 a="0" b="0" c="0.004" d="-0.0001"/>'),
    "paramPoly3": (
        45.0,
        '<paramPoly3 pRange="normalized" aU="0" bU="42" cU="2" dU="-3" '
        'aV="0" bV="0" cV="25" dV="-12"/>',
    ),
}
"""One road each, by what its reference line is: length [m] and geometry."""

_PROFILES = (
    '<elevationProfile><elevation s="0" a="2" b="0.03" c="0.0004" d="0"/>'
    '<elevation s="12" a="2.4176" b="0.0396" c="-0.0005" d="0.000003"/></elevationProfile>'
    '<lateralProfile><superelevation s="0" a="0" b="0" c="0" d="0"/>'
    '<superelevation s="5" a="0" b="0.004" c="0.0001" d="-0.000002"/>'
    '<superelevation s="15" a="0.048" b="-0.0002" c="0" d="0"/></lateralProfile>'
)
_OFFSET = (
    '<laneOffset s="0" a="0.5" b="0" c="0" d="0"/>'
    '<laneOffset s="8" a="0.5" b="0.02" c="-0.001" d="0.00001"/>'
)
_TAPER = (
    '<width sOffset="0" a="3" b="0" c="0" d="0"/>'
    '<width sOffset="4" a="3" b="0.1" c="0.004" d="-0.0003"/>'
)
_CLOSING = '<width sOffset="0" a="1.5" b="-0.1" c="0" d="0"/>'
_BORDER = '<border sOffset="0" a="{}" b="{}" c="0" d="0"/>'
_LEVEL = f'<lane id="-3" type="sidewalk" level="true">{WIDTH}</lane>\n'


def shapes_file(rule: str = "RHT", profiles: bool = True) -> bytes:
    """Unconnected roads of every shape, with profiles, offsets, sections, tapers and borders."""
    roads = []
    for number, (length, shape) in enumerate(SHAPES.values()):
        at = (30.0 * number, -250.0 * number, 0.7 * number - 2.0)
        first = section(
            0.0,
            left=lane(2, link((), (1,)) + _CLOSING) + lane(1, link((), (1,)) + _TAPER),
            right=lane(-1, link((), (-1,)) + WIDTH) + lane(-2, link((), (-2,)) + _TAPER) + _LEVEL,
        )
        second = section(
            11.0,
            left=lane(1, link((1,), ()) + _BORDER.format(3.5, 0.01), "biking"),
            right=lane(-1, link((-1,), ()) + _BORDER.format(-3.25, 0.0))
            + lane(-2, link((-2,), ()) + _BORDER.format(-6.0, -0.02), "shoulder"),
        )
        roads.append(
            road(
                length,
                geometry(shape, length, at=at),
                (_OFFSET if profiles else "") + first + second,
                road_id=f"r{number}",
                more=_PROFILES if profiles else "",
                attributes=f'rule="{rule}"',
            )
        )
    return xodr(*roads)


def shapes(rule: str = "RHT", profiles: bool = True) -> RoadNetwork:
    """The network of :func:`shapes_file`."""
    return read_network(shapes_file(rule, profiles), "shapes")


def composed_file() -> bytes:
    """A road of a line, a spiral, an arc and a line, 30 m each."""
    bend = '<spiral curvStart="0" curvEnd="0.02"/>'
    pieces = ((LINE, 0.0), (bend, 30.0), ('<arc curvature="0.02"/>', 60.0), (LINE, 90.0))
    at, parts = (0.0, 0.0, 0.0), []
    for shape, s in pieces:
        parts.append(geometry(shape, 30.0, s, at))
        alone = read_network(xodr(road(30.0, geometry(shape, 30.0, at=at))), "t").roads["0"]
        at = _far(alone)
    return xodr(road(120.0, "".join(parts)))


def composed() -> RoadNetwork:
    """The network of :func:`composed_file`."""
    return read_network(composed_file(), "composed")


def _far(alone: object) -> tuple[float, float, float]:
    from twin.road.opendrive.road_frame import RoadFrame

    pose = RoadFrame(alone).pose(30.0)  # type: ignore[arg-type]
    return float(pose.x_m), float(pose.y_m), float(pose.heading_rad)


def turned_file() -> bytes:
    """Three roads of 40, 30 and 50 m on a line along x; the second runs the other way.

    Two lanes each way on the first and third; the second has a third lane on the side of its lane
    -2, and its sections are 10 and 20 m long.
    """

    def lanes(links: dict[int, tuple[tuple[int, ...], tuple[int, ...]]], s: float = 0.0) -> str:
        sides = {
            side: "".join(
                lane(i, link(*links[i]) + WIDTH)
                for i in sorted(links, reverse=True)
                if i * side > 0
            )
            for side in (1, -1)
        }
        return section(s, left=sides[1], right=sides[-1])

    first = lanes({i: ((), (-i,)) for i in (2, 1, -1, -2)})
    last = lanes({i: ((-i,), ()) for i in (2, 1, -1, -2)})
    # Road 1 begins where road 2 begins, and ends where road 0 ends.
    near = lanes({i: ((-i,), (i,)) for i in (2, 1, -1, -2)} | {-3: ((), ())})
    far = lanes({i: ((i,), (-i,)) for i in (2, 1, -1, -2)}, 10.0)
    return xodr(
        road(40.0, lanes=first, road_id="0", link=end("successor", "road", "1", "end")),
        road(
            30.0,
            geometry(LINE, 30.0, at=(70.0, 0.0, math.pi)),
            near + far,
            road_id="1",
            link=end("predecessor", "road", "2", "start") + end("successor", "road", "0", "end"),
        ),
        road(
            50.0,
            geometry(LINE, 50.0, at=(70.0, 0.0, 0.0)),
            last,
            road_id="2",
            link=end("predecessor", "road", "1", "start"),
        ),
    )


def turned() -> RoadNetwork:
    """The network of :func:`turned_file`."""
    return read_network(turned_file(), "turned")


TURN_M = 0.5 * math.pi * 20.0
"""Length of the turns of :func:`junction` [m]."""


def junction_file(rule: str = "RHT") -> bytes:
    """A crossing with ways to the left (4), ahead (5) and to the right (6) out of road 0.

    Roads 1 (left), 2 (ahead) and 3 (right) begin at the junction; road 0 of 50 m ends there. The
    ways have one lane, -1 with right-hand traffic, else 1, and come in this order in the file.
    """
    side = -1 if rule == "RHT" else 1
    attributes = f'rule="{rule}"'

    def way(name: str, shape: str, length: float, to: str) -> str:
        inside = lane(side, link((side,), (side,)) + WIDTH)
        lanes = section(left=inside, right="") if side > 0 else section(left="", right=inside)
        return road(
            length,
            geometry(shape, length, at=(50.0, 0.0, 0.0)),
            lanes,
            road_id=name,
            junction="9",
            link=end("predecessor", "road", "0", "end") + end("successor", "road", to, "start"),
            attributes=attributes,
        )

    def leg(name: str, at: tuple[float, float, float]) -> str:
        return road(
            60.0,
            geometry(LINE, 60.0, at=at),
            road_id=name,
            link=end("predecessor", "junction", "9"),
            attributes=attributes,
        )

    connections = "".join(
        f'<connection id="{k}" incomingRoad="0" connectingRoad="{name}" contactPoint="start">'
        f'<laneLink from="{side}" to="{side}"/></connection>'
        for k, name in enumerate(("4", "5", "6"))
    )
    return xodr(
        road(50.0, link=end("successor", "junction", "9"), attributes=attributes),
        leg("1", (70.0, 20.0, 0.5 * math.pi)),
        leg("2", (90.0, 0.0, 0.0)),
        leg("3", (70.0, -20.0, -0.5 * math.pi)),
        way("4", '<arc curvature="0.05"/>', TURN_M, "1"),
        way("5", LINE, 40.0, "2"),
        way("6", '<arc curvature="-0.05"/>', TURN_M, "3"),
        f'<junction id="9" name="j">{connections}</junction>\n',
    )


def junction(rule: str = "RHT") -> RoadNetwork:
    """The network of :func:`junction_file`."""
    return read_network(junction_file(rule), "junction")
