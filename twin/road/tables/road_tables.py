"""A whole road network as flat NumPy tables, the form in which kernels read it.

Roads, junctions and lanes are numbered in the order of the file. A table of things that belong to
others (lanes of a section) is sorted by owner, and the owner's row says where they begin; the row
after the last says where they end.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from twin.road.opendrive.lane_graph import LaneGraph, LaneKey, LaneRoute, lane_graph
from twin.road.opendrive.profile import CubicProfile
from twin.road.opendrive.records import (
    DRIVEN_TYPES,
    LANE_TYPES,
    Cubic,
    LaneSection,
    RoadNetwork,
    RoadRecord,
)
from twin.road.opendrive.road_frame import RoadFrame, traffic_sign
from twin.road.opendrive.road_map import RoadMap
from twin.road.tables.line_pieces import LINE_COLUMNS, line_pieces
from twin.road.tables.road_ways import RoadWays, no_ways, road_ways
from twin.road.tables.way_lengths import way_lengths

LINE_PIECES_MAX = 500_000
"""Most parts of all reference lines, 44 MB."""
LANE_TYPE_CODES = tuple(sorted(LANE_TYPES))
"""Lane types; a code is an index of it."""
ROAD_COLUMNS = ("line", "section", "elevation", "superelevation", "lane_offset")
"""Where a road's rows begin in ``lines`` and ``sections``, and in ``profiles``."""
EXTENT_COLUMNS = ("length_m", "x_low_m", "y_low_m", "x_high_m", "y_high_m", "reach_m")
"""A road's length, the box around its reference line, and the farthest border from it."""
CUBIC_COLUMNS = ("start_m", "a", "b", "c", "d")
SECTION_COLUMNS = ("lane", "left", "level_left", "level_right")
"""Where a section's lanes begin, from the left to the right; how many are on the left; ids of the
innermost level lane on each side, 0: none."""
LANE_COLUMNS = ("width", "bordered", "type", "sign", "before", "after")
"""Where a lane's rows of ``widths`` begin; 1 if they are borders; the code of its type; the way it
is driven (1 along s, -1 against it, 0 both); the lanes before and after it in the same road, 0:
none. Of several the first that the file names counts."""


@dataclass(frozen=True, slots=True)
class RoadTables:
    """Make it with :func:`road_tables`; R roads, S sections, L lanes."""

    roads: np.ndarray
    """int32 [R + 1, 5] (:data:`ROAD_COLUMNS`)."""
    extents: np.ndarray
    """float64 [R, 6] (:data:`EXTENT_COLUMNS`)."""
    lines: np.ndarray
    """Parts of reference lines, float64 [P, 11] (``LINE_COLUMNS``)."""
    profiles: np.ndarray
    """Profiles of roads by station, each cubic up to the next, float64 [C, 5]."""
    widths: np.ndarray
    """Widths or borders of lanes by way since the section begins, float64 [D, 5]."""
    section_starts_m: np.ndarray
    """float64 [S]."""
    sections: np.ndarray
    """int32 [S + 1, 4] (:data:`SECTION_COLUMNS`)."""
    lanes: np.ndarray
    """int32 [L + 1, 6] (:data:`LANE_COLUMNS`)."""
    ways: RoadWays
    lengths_m: np.ndarray
    """Shortest ways between ends of roads, float64 [2 R, 2 R]; see ``way_lengths``. Empty in a
    network of more roads than it is made for."""
    road_ids: tuple[str, ...]
    """Ids by number."""

    def road_number(self, road_id: str) -> int:
        """The number of a road.

        Raises:
            ValueError: there is no such road.
        """
        if road_id not in self.road_ids:
            raise ValueError(f"road {road_id[:40]} does not exist")
        return self.road_ids.index(road_id)

    def route_numbers(self, route: LaneRoute) -> np.ndarray:
        """Numbers of the roads along a route, each stay on a road once, int32."""
        roads = [step.lane.key.road for step in route.steps]
        return np.array([self.road_number(road) for road, _ in itertools.groupby(roads)], np.int32)


def road_tables(network: RoadNetwork) -> RoadTables:
    """The tables of a network.

    Raises:
        ValueError: a reference line has no direction somewhere, or there are too many parts.
    """
    frames = tuple(RoadMap(network).frames.values())
    lines = _lines(network, frames)
    graph = lane_graph(network)
    pool, widths = _Cubics(), _Cubics()
    roads: list[tuple[int, ...]] = []
    sections: list[tuple[int, ...]] = []
    lanes: list[tuple[int, ...]] = []
    links = _lane_links(network, graph)
    line_first = np.cumsum([0, *map(len, lines)]).tolist()
    for number, road in enumerate(network.roads.values()):
        first = (pool.count, pool.add(road.elevation), pool.add(road.superelevation))
        roads.append((line_first[number], len(sections), *first))
        pool.add(road.lane_offset)
        for index, section in enumerate(road.sections):
            level = (frames[number].sections[index].level_from(side) for side in (1, -1))
            sections.append((len(lanes), len(section.left), *level))
            lanes += [
                (
                    *_lane_row(road, section, lane_id, widths),
                    *links[LaneKey(road.id, index, lane_id)],
                )
                for lane_id in _ids(section)
            ]
    roads.append((line_first[-1], len(sections), pool.count, pool.count, pool.count))
    sections.append((len(lanes), 0, 0, 0))
    lanes.append((widths.count, *(0,) * (len(LANE_COLUMNS) - 1)))
    ways = road_ways(network, frames, graph)
    return RoadTables(
        roads=np.array(roads, np.int32),
        extents=np.array([_extent(frame, rows) for frame, rows in zip(frames, lines, strict=True)]),
        lines=np.concatenate(lines),
        profiles=np.array(pool.rows),
        widths=np.array(widths.rows).reshape(-1, len(CUBIC_COLUMNS)),
        section_starts_m=np.array([s.start_m for r in network.roads.values() for s in r.sections]),
        sections=np.array(sections, np.int32),
        lanes=np.array(lanes, np.int32),
        ways=ways,
        lengths_m=way_lengths(ways, np.array([road.length_m for road in network.roads.values()])),
        road_ids=tuple(network.roads),
    )


def _lines(network: RoadNetwork, frames: tuple[RoadFrame, ...]) -> list[np.ndarray]:
    """Parts of all reference lines."""
    lines: list[np.ndarray] = []
    left = LINE_PIECES_MAX
    for frame in frames:
        try:
            lines.append(line_pieces(frame.line, left))
        except ValueError as error:
            raise ValueError(f"{network.file}: road {frame.road.id[:40]}: {error}") from None
        left -= len(lines[-1])
    return lines


def flat_tables() -> RoadTables:
    """Tables without a road: flat ground."""
    return RoadTables(
        roads=np.zeros((1, len(ROAD_COLUMNS)), np.int32),
        extents=np.zeros((0, len(EXTENT_COLUMNS))),
        lines=np.zeros((0, len(LINE_COLUMNS))),
        profiles=np.zeros((0, len(CUBIC_COLUMNS))),
        widths=np.zeros((0, len(CUBIC_COLUMNS))),
        section_starts_m=np.zeros(0),
        sections=np.zeros((1, len(SECTION_COLUMNS)), np.int32),
        lanes=np.zeros((1, len(LANE_COLUMNS)), np.int32),
        ways=no_ways(),
        lengths_m=np.zeros((0, 0)),
        road_ids=(),
    )


def driven_codes() -> np.ndarray:
    """By lane type code: 1 where cars drive, int32."""
    return np.array([name in DRIVEN_TYPES for name in LANE_TYPE_CODES], np.int32)


class _Cubics:
    """Rows of all cubics; each profile has at least one, and the first holds before its start."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, ...]] = []

    @property
    def count(self) -> int:
        """Rows so far."""
        return len(self.rows)

    def add(self, cubics: tuple[Cubic, ...]) -> int:
        """Append a profile; the count of rows behind it."""
        if not cubics or cubics[0].start_m > 0.0:
            self.rows.append((0.0,) * len(CUBIC_COLUMNS))
        self.rows += [(c.start_m, c.a, c.b, c.c, c.d) for c in cubics]
        return self.count


def _ids(section: LaneSection) -> list[int]:
    """Lane ids from the left to the right, the order of a section's rows."""
    return [lane.id for lane in section.lanes]


def _lane_row(
    road: RoadRecord, section: LaneSection, lane_id: int, pool: _Cubics
) -> tuple[int, int, int, int]:
    lane = section.lane(lane_id)
    assert lane is not None
    first = pool.count
    pool.add(lane.widths or lane.borders)
    code = LANE_TYPE_CODES.index(lane.type)
    return first, int(not lane.widths), code, traffic_sign(road, lane)


def _lane_links(network: RoadNetwork, graph: LaneGraph) -> dict[LaneKey, tuple[int, int]]:
    """Lanes before and after every lane in the same road, 0: none; other roads are in the ways."""
    joints = graph.joints
    links = {}
    for road in network.roads.values():
        last = len(road.sections) - 1
        for index, section in enumerate(road.sections):
            for lane in section.lanes:
                key = LaneKey(road.id, index, lane.id)
                before = joints.get((key, "start"), ()) if index > 0 else ()
                after = joints.get((key, "end"), ()) if index < last else ()
                links[key] = _first(before, lane.predecessors), _first(after, lane.successors)
    return links


def _first(joints: tuple[tuple[LaneKey, str], ...], named: tuple[int, ...]) -> int:
    """The first lane that the file names, else the first that names this one, else 0."""
    touching = [key.lane for key, _ in joints]
    return next((lane for lane in (*named, *touching) if lane in touching), 0)


def _extent(frame: RoadFrame, rows: np.ndarray) -> tuple[float, ...]:
    """Row of :data:`EXTENT_COLUMNS`; probes are at most a twentieth of a turn apart, so the box
    gets a margin of the longest part's sagitta."""
    length = frame.road.length_m
    place = frame.line.at(np.append(rows[:, 0], length))
    steps = np.diff(np.append(rows[:, 0], length))
    bend = np.abs(rows[:, 9]) + np.abs(rows[:, 10]) * steps
    margin = float(np.max(bend * steps * steps)) + 0.01
    x, y = place.x_m, place.y_m
    reach = max(_reach(frame, index) for index in range(len(frame.sections)))
    low, high = (x.min() - margin, y.min() - margin), (x.max() + margin, y.max() + margin)
    return (length, *map(float, low), *map(float, high), reach)


def _reach(frame: RoadFrame, index: int) -> float:
    """A bound of |t| of the borders of a section: sums of bounds of cubics."""
    section = frame.road.sections[index]
    offset = _bound(frame.road.lane_offset, 0.0, frame.road.length_m)
    sides = []
    for side in (section.left, section.right):
        width = 0.0
        for lane in side:
            bound = _bound(lane.widths or lane.borders, 0.0, section.end_m - section.start_m)
            width = width + bound if lane.widths else max(width, bound)
        sides.append(width)
    return offset + max(sides)


def _bound(cubics: tuple[Cubic, ...], begin: float, end: float) -> float:
    """Largest magnitude of a profile, from 64 probes a cubic and a tenth more."""
    if not cubics:
        return 0.0
    starts = [max(min(cubic.start_m, end), begin) for cubic in cubics] + [end]
    probes = np.concatenate([np.linspace(a, b, 64) for a, b in itertools.pairwise(starts)])
    return 1.1 * float(np.abs(CubicProfile(cubics).at(probes)[0]).max())
