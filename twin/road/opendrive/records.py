"""A road network as it stands in a file: frozen records in metres, radians and seconds.

``line`` is the line of the file where a record begins, from 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from twin.road.opendrive.furniture import RoadObject, RoadSignal

ContactPoint = Literal["start", "end"]
GeometryKind = Literal["line", "arc", "spiral", "cubic"]

DRIVEN_TYPES = frozenset(
    {
        *("HOV", "bidirectional", "bus", "connectingRamp", "driving", "entry", "exit"),
        *("mwyEntry", "mwyExit", "offRamp", "onRamp", "slipLane", "taxi"),
    }
)
"""Lane types that cars drive on; routes lead there unless they are told others."""
LANE_TYPES = DRIVEN_TYPES | {
    *("biking", "border", "curb", "median", "none", "parking", "rail", "restricted"),
    *("roadWorks", "shared", "shoulder", "sidewalk", "special1", "special2", "special3"),
    *("stop", "tram", "walking"),
}
"""Lane types of OpenDRIVE 1.4 to 1.8."""


@dataclass(frozen=True, slots=True)
class Cubic:
    """A polynomial a + b d + c d^2 + d d^3 of the distance d from ``start_m``."""

    start_m: float
    """Where it begins; it holds up to the next."""
    a: float
    b: float
    c: float
    d: float


@dataclass(frozen=True, slots=True)
class GeometryRecord:
    """A piece of the reference line."""

    start_m: float
    """Station of its beginning [m]."""
    length_m: float
    x_m: float
    y_m: float
    heading_rad: float
    kind: GeometryKind
    curvature: tuple[float, float]
    """At its beginning and end, to the left positive; 0 for a cubic [1/m]."""
    u: tuple[float, float, float, float]
    """Coefficients of u(p) of a cubic, in the axes of its beginning."""
    v: tuple[float, float, float, float]
    p_max: float | None
    """Where p ends; None: where the curve is ``length_m`` long (poly3)."""
    line: int


@dataclass(frozen=True, slots=True)
class RoadLink:
    """What joins an end of a road."""

    kind: Literal["road", "junction"]
    id: str
    contact: ContactPoint | None
    """Which end of that road; None of a junction."""
    line: int


@dataclass(frozen=True, slots=True)
class MarkLine:
    """A line of a road mark."""

    length_m: float
    """Of a stroke; 0: it has no gaps [m]."""
    space_m: float
    """Between strokes [m]."""
    t_offset_m: float
    """To the left of the lane's border [m]."""
    s_offset_m: float
    """Where the first stroke begins [m]."""
    width_m: float
    color: str


@dataclass(frozen=True, slots=True)
class RoadMark:
    """Mark on the outer border of a lane."""

    start_m: float
    """From the beginning of the lane section; it holds up to the next [m]."""
    type: str
    """Such as ``solid``, ``broken``, ``none``."""
    weight: str
    color: str
    width_m: float
    lane_change: str
    """Who may cross it: ``both``, ``none``, ``increase`` or ``decrease`` of the lane's id."""
    height_m: float
    material: str
    lines: tuple[MarkLine, ...]
    """Given ones; none: those that ``type`` says."""


@dataclass(frozen=True, slots=True)
class LaneMaterial:
    """Surface of a lane from ``start_m`` of its section on."""

    start_m: float
    friction: float
    surface: str
    roughness: float


@dataclass(frozen=True, slots=True)
class SpeedLimit:
    """Highest speed from ``start_m`` on; None: no limit [m/s]."""

    start_m: float
    speed_mps: float | None


@dataclass(frozen=True, slots=True)
class LaneHeight:
    """Heights above the road's surface from ``start_m`` of the section on [m]."""

    start_m: float
    inner_m: float
    outer_m: float


@dataclass(frozen=True, slots=True)
class Lane:
    """A lane of a section."""

    id: int
    """Positive to the left of the reference line, negative to the right; never 0 but for marks."""
    type: str
    level: bool
    """True: level across, whatever the superelevation."""
    direction: Literal["standard", "reversed", "both"]
    """Of its traffic, as seen by the road's rule."""
    widths: tuple[Cubic, ...]
    """From the beginning of the section; empty if it has borders."""
    borders: tuple[Cubic, ...]
    """t of its outer border from the offset reference line, from the beginning of the section."""
    predecessors: tuple[int, ...]
    successors: tuple[int, ...]
    marks: tuple[RoadMark, ...]
    materials: tuple[LaneMaterial, ...]
    speeds: tuple[SpeedLimit, ...]
    heights: tuple[LaneHeight, ...]
    line: int


@dataclass(frozen=True, slots=True)
class LaneSection:
    """Lanes between two stations."""

    start_m: float
    end_m: float
    left: tuple[Lane, ...]
    """Ids 1, 2, ... from the inside to the outside."""
    center: Lane
    right: tuple[Lane, ...]
    """Ids -1, -2, ... from the inside to the outside."""
    line: int

    def lane(self, lane_id: int) -> Lane | None:
        """The lane of that id, None if there is none; 0 is no lane."""
        side = self.left if lane_id > 0 else self.right
        index = abs(lane_id) - 1
        return side[index] if 0 <= index < len(side) else None

    @property
    def lanes(self) -> tuple[Lane, ...]:
        """All lanes from the left to the right, without the centre."""
        return (*reversed(self.left), *self.right)


@dataclass(frozen=True, slots=True)
class RoadType:
    """Kind of road from ``start_m`` on."""

    start_m: float
    type: str
    country: str
    speed_mps: float | None
    """Speed limit; None: none is given [m/s]."""


@dataclass(frozen=True, slots=True)
class RoadRecord:
    """A road: its reference line, and lanes along it."""

    id: str
    name: str
    length_m: float
    rule: Literal["RHT", "LHT"]
    """Right-hand or left-hand traffic."""
    junction: str | None
    """The junction it leads through."""
    predecessor: RoadLink | None
    successor: RoadLink | None
    types: tuple[RoadType, ...]
    geometry: tuple[GeometryRecord, ...]
    elevation: tuple[Cubic, ...]
    superelevation: tuple[Cubic, ...]
    lane_offset: tuple[Cubic, ...]
    sections: tuple[LaneSection, ...]
    objects: tuple[RoadObject, ...]
    signals: tuple[RoadSignal, ...]
    line: int


@dataclass(frozen=True, slots=True)
class JunctionConnection:
    """A way into a junction."""

    id: str
    incoming_road: str
    connecting_road: str
    """The road through the junction; of a direct junction the one that leads away."""
    contact: ContactPoint
    """End of the connecting road at which it is entered."""
    lane_links: tuple[tuple[int, int], ...]
    """Incoming and connecting lane ids."""
    line: int


@dataclass(frozen=True, slots=True)
class Junction:
    """A junction."""

    id: str
    name: str
    type: Literal["default", "direct"]
    connections: tuple[JunctionConnection, ...]
    priorities: tuple[tuple[str, str], ...]
    """Roads that go first, and those that wait for them."""
    line: int


@dataclass(frozen=True, slots=True)
class RoadNetwork:
    """All roads and junctions of a file."""

    file: str
    version: tuple[int, int]
    name: str
    geo_reference: str
    """As it stands in the file; coordinates are not turned into others."""
    offset: tuple[float, float, float, float] | None
    """x, y, z [m] and heading [rad] that were taken off all coordinates, None if none is given."""
    roads: dict[str, RoadRecord]
    """By id, in the order of the file."""
    junctions: dict[str, Junction]
    notes: tuple[str, ...]
    """What was left out and may be missed, a line each."""
    controllers: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Signals that switch together (``controller``): ids of signals, by id."""
