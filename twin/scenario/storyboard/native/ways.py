"""Ways of actors: lanes they follow through junctions, lines they walk, where two ways cross."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.road.opendrive.lane_graph import DrivenLane, LaneKey
from twin.scenario.storyboard.native.ground import ScenarioGround, SpotError
from twin.scenario.storyboard.native.starts import StartPlace
from twin.scenario.storyboard.program.places import (
    FixedPosition,
    RoadRoute,
    RouteLeg,
    Trajectory,
    TrajectoryPiece,
)

WAY_MAX_M = 2000.0
"""How far ways are followed [m]."""
_STEP_M = 1.0
_STRAIGHT_MAX_RAD = math.radians(30.0)
"""Ways through a junction that turn by less lead straight on."""


@dataclass(frozen=True, slots=True)
class ActorWay:
    """A line that an actor follows; arrays [P]."""

    distance_m: np.ndarray
    """From its beginning."""
    x_m: np.ndarray
    y_m: np.ndarray
    legs: tuple[RouteLeg, ...] = ()
    """Lanes that it follows; none of a trajectory."""
    leg: np.ndarray | None = None
    """Index of the leg of each point."""
    s_m: np.ndarray | None = None
    """Place of each point along the leg's road."""
    offset_m: float = 0.0
    """To the left of the middles of the lanes, as the actor sees it."""
    trajectory: int = -1
    """Index of the trajectory; -1: along lanes."""


def followed_lanes(
    place: StartPlace, ground: ScenarioGround, turns: Sequence[str], key: str = "turns"
) -> list[RouteLeg]:
    """The lanes that an actor follows from its start, a turn at every junction, then straight on.

    Raises:
        SpotError: its lane does not lead there.
    """
    record = ground.frame(place.road).road
    section = int(ground.frame(place.road).section_at(place.s_m))
    lane = DrivenLane(LaneKey(record.id, section, place.lane), place.sign)
    legs = [_leg(ground, lane, place.s_m)]
    length, left = 0.0, list(turns)
    while length < WAY_MAX_M:
        after = ground.graph.successors(lane)
        if not after:
            break
        lane = _next_lane(ground, lane, after, left, key)
        legs.append(_leg(ground, lane, None))
        length += abs(legs[-1].to_s_m - legs[-1].from_s_m)
    if left:
        raise SpotError(key, f"'{left[0]}': no junction lies ahead, {len(turns)} needed")
    return _joined(legs)


def _next_lane(
    ground: ScenarioGround,
    lane: DrivenLane,
    after: tuple[DrivenLane, ...],
    left: list[str],
    key: str,
) -> DrivenLane:
    bends = {follower: _bend(ground, follower) for follower in after}
    at_junction = any(ground.network.roads[one.key.road].junction is not None for one in after)
    if at_junction and left:
        turn = left.pop(0)
        fitting = {one: bend for one, bend in bends.items() if _turn_name(bend) == turn}
        if not fitting:
            ways = ", ".join(dict.fromkeys(_turn_name(bend) for bend in bends.values()))
            road = ground.label(ground.number(lane.key.road))
            raise SpotError(
                key, f"'{turn}': its lane on road {road} does not lead there; it leads {ways}"
            )
        bends = fitting
    return min(bends, key=lambda one: abs(bends[one]))


def _bend(ground: ScenarioGround, lane: DrivenLane) -> float:
    """By how much the heading changes along a road, to the left positive."""
    frame = ground.roads.frames[lane.key.road]
    ends = [float(frame.pose(s).heading_rad) for s in (0.0, frame.road.length_m)]
    return float(lane.sign * math.remainder(ends[1] - ends[0], 2.0 * math.pi))


def _turn_name(bend_rad: float) -> str:
    if abs(bend_rad) < _STRAIGHT_MAX_RAD:
        return "straight"
    return "left" if bend_rad > 0.0 else "right"


def _leg(ground: ScenarioGround, lane: DrivenLane, from_s: float | None) -> RouteLeg:
    road = ground.network.roads[lane.key.road]
    section = road.sections[lane.key.section]
    ends = section.start_m, section.end_m
    begin, end = ends if lane.sign > 0 else ends[::-1]
    start = begin if from_s is None else from_s
    return RouteLeg(ground.number(road.id), start, end, lane.key.lane)


def _joined(legs: list[RouteLeg]) -> list[RouteLeg]:
    """Stretches of one lane in one piece."""
    joined = legs[:1]
    for leg in legs[1:]:
        last = joined[-1]
        if (leg.road, leg.lane, leg.from_s_m) == (last.road, last.lane, last.to_s_m):
            joined[-1] = RouteLeg(last.road, last.from_s_m, leg.to_s_m, last.lane)
        else:
            joined.append(leg)
    return joined


def route_of(name: str, legs: list[RouteLeg]) -> RoadRoute:
    """The route along lanes."""
    return RoadRoute(name, False, tuple(legs))


def lane_way(place: StartPlace, ground: ScenarioGround, legs: list[RouteLeg]) -> ActorWay:
    """The line of an actor's middle along lanes, at its distance from their middles."""
    offset = place.offset_m * place.sign
    columns: list[list[np.ndarray]] = [[], [], [], []]
    for index, leg in enumerate(legs):
        count = max(int(abs(leg.to_s_m - leg.from_s_m) / _STEP_M) + 1, 2)
        s = np.linspace(leg.from_s_m, leg.to_s_m, count)
        pose = ground.frame(leg.road).lane_pose(leg.lane, s, _sign(leg) * offset)
        for column, values in zip(
            columns, (pose.x_m, pose.y_m, np.full(count, index), s), strict=True
        ):
            column.append(values)
    x, y, numbers, stations = (np.concatenate(column) for column in columns)
    distance = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    return ActorWay(distance, x, y, tuple(legs), numbers, stations, offset)


def _sign(leg: RouteLeg) -> int:
    return 1 if leg.to_s_m >= leg.from_s_m else -1


def line_way(points: list[FixedPosition], trajectory: int) -> ActorWay:
    """The line through points."""
    x, y = (np.array([getattr(one, name) for one in points]) for name in ("x_m", "y_m"))
    distance = np.concatenate([[0.0], np.cumsum(_lengths(points))])
    return ActorWay(distance, x, y, trajectory=trajectory)


def line_trajectory(name: str, points: list[FixedPosition]) -> Trajectory:
    """The trajectory along straight lines through points, headed along them.

    Raises:
        SpotError: two points that follow one another are the same.
    """
    pieces, start, heading = [], 0.0, 0.0
    for index, length in enumerate(_lengths(points)):
        one, other = points[index], points[index + 1]
        if length < 1e-3:
            raise SpotError("", "two points that follow one another are the same place")
        direct = math.atan2(other.y_m - one.y_m, other.x_m - one.x_m)
        heading += math.remainder(direct - heading, 2.0 * math.pi)  # unwrapped
        pieces.append(
            TrajectoryPiece(
                start,
                length,
                (one.x_m, (other.x_m - one.x_m) / length, 0.0, 0.0),
                (one.y_m, (other.y_m - one.y_m) / length, 0.0, 0.0),
                (one.z_m, (other.z_m - one.z_m) / length, 0.0, 0.0),
                (heading, 0.0, 0.0, 0.0),
            )
        )
        start += length
    return Trajectory(name, False, False, tuple(pieces))


def _lengths(points: list[FixedPosition]) -> list[float]:
    return [
        math.hypot(other.x_m - one.x_m, other.y_m - one.y_m)
        for one, other in itertools.pairwise(points)
    ]


def crossing(one: ActorWay, other: ActorWay) -> tuple[float, float] | None:
    """How far along both ways they first cross, first along ``one``; None: they do not."""
    dx, dy = np.diff(one.x_m)[:, None], np.diff(one.y_m)[:, None]
    ex, ey = np.diff(other.x_m)[None, :], np.diff(other.y_m)[None, :]
    gap_x = other.x_m[None, :-1] - one.x_m[:-1, None]
    gap_y = other.y_m[None, :-1] - one.y_m[:-1, None]
    area = dx * ey - dy * ex
    # Parallel lines share no single point.
    flat = np.abs(area) < 1e-9
    area = np.where(flat, 1.0, area)
    along, aside = (gap_x * ey - gap_y * ex) / area, (gap_x * dy - gap_y * dx) / area
    hits = ~flat & (along >= 0.0) & (along <= 1.0) & (aside >= 0.0) & (aside <= 1.0)
    if not hits.any():
        return None
    row, column = np.argwhere(hits)[0]
    steps = np.diff(one.distance_m)[row], np.diff(other.distance_m)[column]
    return (
        float(one.distance_m[row] + along[row, column] * steps[0]),
        float(other.distance_m[column] + aside[row, column] * steps[1]),
    )


def position_on(way: ActorWay, distance_m: float, ground: ScenarioGround) -> FixedPosition:
    """The place so far along a way along lanes."""
    assert way.leg is not None
    assert way.s_m is not None
    at = min(max(distance_m, 0.0), float(way.distance_m[-1]))
    index = int(np.clip(np.searchsorted(way.distance_m, at, "right") - 1, 0, len(way.s_m) - 2))
    leg, s = way.legs[int(way.leg[index])], float(way.s_m[index])
    step = float(way.distance_m[index + 1] - way.distance_m[index])
    if way.leg[index + 1] == way.leg[index] and step > 0.0:
        share = (at - float(way.distance_m[index])) / step
        s += share * float(way.s_m[index + 1] - way.s_m[index])
    return ground.fixed(leg.road, leg.lane, s, _sign(leg) * way.offset_m, _sign(leg))


def nearest(way: ActorWay, place: FixedPosition) -> float:
    """How far along a way its point is that is nearest to a place."""
    x, y = way.x_m[:-1], way.y_m[:-1]
    dx, dy = np.diff(way.x_m), np.diff(way.y_m)
    share = (place.x_m - x) * dx + (place.y_m - y) * dy
    share = np.clip(share / np.maximum(dx * dx + dy * dy, 1e-12), 0.0, 1.0)
    apart = np.hypot(x + share * dx - place.x_m, y + share * dy - place.y_m)
    index = int(np.argmin(apart))
    return float(way.distance_m[index] + share[index] * np.diff(way.distance_m)[index])
