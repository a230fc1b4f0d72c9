"""Roads as a scenario file speaks of them: by name, lanes counted from the right, sides."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from schemas.validation import Mistake, suggest
from twin.road.opendrive.lane_graph import LaneGraph, lane_graph
from twin.road.opendrive.records import DRIVEN_TYPES, LaneSection, RoadNetwork
from twin.road.opendrive.road_frame import RoadFrame, traffic_sign
from twin.road.opendrive.road_map import RoadMap
from twin.scenario.storyboard.program.places import FixedPosition

T = TypeVar("T")

_GROUNDS_MAX = 4

_SIDE_TYPES = {
    "footway": ("sidewalk", "walking"),
    "parked": ("parking",),
    "shoulder": ("shoulder", "stop", "border"),
}
_SIDE_WORDS = {"footway": "footway", "parked": "parking lane", "shoulder": "shoulder"}


class SpotError(ValueError):
    """A place that does not exist; ``key`` is the key that says it, the message what is allowed."""

    def __init__(self, key: str, message: str) -> None:
        super().__init__(message)
        self.key = key


@dataclass(slots=True)
class NativeMistakes:
    """Everything that is wrong with a scenario, in the order of the file."""

    mistakes: list[Mistake]

    def add(self, path: str, message: str) -> None:
        """Note a mistake, each once."""
        mistake = Mistake(path, message)
        if mistake not in self.mistakes:
            self.mistakes.append(mistake)

    def attempt(self, path: str, make: Callable[[], T]) -> T | None:
        """What ``make`` gives; None if it raised a :class:`SpotError`, which is noted."""
        try:
            return make()
        except SpotError as error:
            self.add(f"{path}.{error.key}" if error.key else path, str(error))
            return None


@dataclass(frozen=True, slots=True)
class ScenarioGround:
    """A road network; make it with :func:`scenario_ground`."""

    roads: RoadMap
    graph: LaneGraph

    @property
    def network(self) -> RoadNetwork:
        """The records."""
        return self.roads.network

    def road_number(self, name: str) -> int:
        """Number of a road by its id or name; of the first one if there is no name.

        Raises:
            SpotError: there is none.
        """
        if not name:
            return 0
        roads = list(self.network.roads.values())
        for number, road in enumerate(roads):
            if name in (road.id, road.name):
                return number
        names = [road.name or road.id for road in roads if road.junction is None]
        raise SpotError("road", f"no road '{name}'; {suggest(name, names[:20])}")

    def frame(self, road: int) -> RoadFrame:
        """The coordinates of a road by its number."""
        return list(self.roads.frames.values())[road]

    def number(self, road_id: str) -> int:
        """Number of a road by its id."""
        return list(self.roads.frames).index(road_id)

    def label(self, road: int) -> str:
        """What people call a road."""
        record = self.frame(road).road
        return str(record.name or record.id)

    def section(self, road: int, s_m: float, key: str = "s_m") -> LaneSection:
        """The lane section at a station.

        Raises:
            SpotError: the station lies beyond the road.
        """
        frame = self.frame(road)
        length = frame.road.length_m
        if not 0.0 <= s_m <= length:
            words = f"{s_m:g} m along the road, allowed: 0 to {length:g}"
            raise SpotError(key, f"{words}, the length of road {self.label(road)}")
        return frame.sections[int(frame.section_at(s_m))].section

    def lanes(self, road: int, s_m: float, sign: int, key: str = "s_m") -> list[int]:
        """Ids of the lanes driven along s (``sign`` 1) or against it, from the right as their
        drivers see them."""
        section = self.section(road, s_m, key)
        record = self.frame(road).road
        driven = [
            lane.id
            for lane in section.lanes
            if lane.type in DRIVEN_TYPES and traffic_sign(record, lane) in (sign, 0)
        ]
        return driven[::-1] if sign > 0 else driven

    def lane(self, road: int, s_m: float, sign: int, count: int, key: str = "lane") -> int:
        """Id of the lane with a number counted from the right.

        Raises:
            SpotError: there are not so many.
        """
        lanes = self.lanes(road, s_m, sign)
        if not 1 <= count <= len(lanes):
            where = "against s" if sign < 0 else "along s"
            names = f"1 to {len(lanes)}" if lanes else "none"
            raise SpotError(
                key,
                f"lane {count} is not on road {self.label(road)} at {s_m:g} m; "
                f"allowed {where}: {names}",
            )
        return lanes[count - 1]

    def beside(self, road: int, s_m: float, kind: str, side: str) -> int:
        """Id of the footway, parking lane or shoulder on a side as seen along s.

        Raises:
            SpotError: there is none.
        """
        section = self.section(road, s_m)
        lanes = section.left if side == "left" else section.right
        fitting = [lane.id for lane in lanes if lane.type in _SIDE_TYPES[kind]]
        if not fitting:
            types = ", ".join(dict.fromkeys(lane.type for lane in lanes)) or "no lanes"
            raise SpotError(
                kind,
                f"no {_SIDE_WORDS[kind]} on the {side} of road {self.label(road)} at {s_m:g} m; "
                f"there: {types}; another place: lateral_m",
            )
        return int(fitting[-1] if kind == "footway" else fitting[0])

    def lateral(self, road: int, s_m: float, t_m: float) -> tuple[int, float]:
        """The lane at a distance to the left of lane 0, and how far left of its middle that is;
        lane 0 beside all lanes."""
        self.section(road, s_m)
        frame = self.frame(road)
        middle = float(frame.sections[int(frame.section_at(s_m))].centre(0, _array(s_m))[0])
        lane = int(frame.lane_at(s_m, middle + t_m))
        return lane, middle + t_m - self.middle(road, lane, s_m)

    def middle(self, road: int, lane: int, s_m: float) -> float:
        """t of the middle of a lane."""
        frame = self.frame(road)
        return float(frame.sections[int(frame.section_at(s_m))].centre(lane, _array(s_m))[0])

    def edge(self, road: int, s_m: float, side: str) -> float:
        """t of the outer border of the outermost lane of a side."""
        frame = self.frame(road)
        section = frame.sections[int(frame.section_at(s_m))]
        lane = len(section.section.left) if side == "left" else -len(section.section.right)
        return float(section.outer(lane, _array(s_m))[0])

    def fixed(
        self, road: int, lane: int, s_m: float, offset_m: float, sign: int, turn_rad: float = 0.0
    ) -> FixedPosition:
        """A place on a lane: ``offset_m`` to the left of its middle along s, for a body that heads
        along s (``sign`` 1) or against it, and is turned to the left of that."""
        pose = self.frame(road).lane_pose(lane, s_m, offset_m)
        heading = float(pose.heading_rad) + (0.0 if sign > 0 else math.pi) + turn_rad
        c, s = math.cos(turn_rad), math.sin(turn_rad)
        pitch, roll = sign * float(pose.pitch_rad), sign * float(pose.roll_rad)
        return FixedPosition(
            x_m=float(pose.x_m),
            y_m=float(pose.y_m),
            z_m=float(pose.z_m),
            heading_rad=math.remainder(heading, 2.0 * math.pi),
            # For the small angles of roads; a turned body leans the other way.
            pitch_rad=c * pitch - s * roll,
            roll_rad=s * pitch + c * roll,
            road=road,
            s_m=s_m,
            t_m=self.middle(road, lane, s_m) + offset_m,
            lane=lane,
            lane_offset_m=offset_m,
        )


_grounds: deque[ScenarioGround] = deque(maxlen=_GROUNDS_MAX)


def scenario_ground(network: RoadNetwork) -> ScenarioGround:
    """The ground of a network.

    Scenarios of a campaign share few networks, so the last ones are kept.

    Raises:
        ValueError: a reference line has no direction somewhere.
    """
    for known in _grounds:
        if known.network is network:
            return known
    ground = ScenarioGround(RoadMap(network), lane_graph(network))
    _grounds.append(ground)
    return ground


def _array(s_m: float) -> np.ndarray:
    return np.asarray(s_m, float)
