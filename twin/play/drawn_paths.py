"""Trajectories and routes that entities were told to follow, as lines for the viewer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from schemas.files.played_scenario import TEXT_CHARS_MAX, PlayPath
from twin.records.play_file import packed_rows
from twin.road.opendrive.road_map import RoadMap
from twin.road.surface.stations import section_stations
from twin.road.thinning import ERROR_M, kept_points
from twin.scenario.storyboard.program.actions import (
    AcquirePositionAction,
    Action,
    AssignRouteAction,
    FollowTrajectoryAction,
)
from twin.scenario.storyboard.program.places import RoadRoute, Trajectory
from twin.scenario.storyboard.program.program import Program

_PIECE_POINTS_MAX = 1_000
_PIECES_ERROR_M = 0.01
_ABOVE_M = 0.05


class BegunAction(NamedTuple):
    """An action at the moment at which an entity began it."""

    action: Action
    actor: int
    pose: tuple[float, float, float, float]
    """The entity's x, y, z [m] and heading [rad]."""


def drawn_paths(
    program: Program, roads: RoadMap | None, begun: Sequence[BegunAction]
) -> list[PlayPath]:
    """Lines of the trajectories and routes of actions that began, each once."""
    drawn: dict[tuple[object, ...], PlayPath] = {}
    for action, actor, pose in begun:
        if isinstance(action, FollowTrajectoryAction):
            trajectory = program.trajectories[action.trajectory]
            moves = trajectory.from_actor
            key = ("trajectory", action.trajectory, *((actor, pose) if moves else ()))
            if key not in drawn:
                points = trajectory_points(trajectory)
                drawn[key] = _path(trajectory.name, _placed(points, pose) if moves else points)
        elif roads is not None and (route := _route(action, roads, pose)) >= 0:
            key = ("route", route)
            if key not in drawn:
                name = program.routes[route].name
                points = route_points(program.routes[route], roads)
                drawn[key] = PlayPath(
                    kind="route", name=name[:TEXT_CHARS_MAX], points=packed_rows(points)
                )
    return list(drawn.values())


def trajectory_points(trajectory: Trajectory) -> np.ndarray:
    """Points of a trajectory in the axes it is given in [N, 3] [m]."""
    at, points = [], []
    for piece in trajectory.pieces:
        bend = 0.0
        for _, _, second, third in (piece.x, piece.y, piece.z):
            bend += max(abs(2.0 * second), abs(2.0 * second + 6.0 * third * piece.length_m))
        count = int(np.ceil(piece.length_m * np.sqrt(bend / (8.0 * _PIECES_ERROR_M))))
        ahead = np.linspace(0.0, piece.length_m, min(max(count, 1), _PIECE_POINTS_MAX) + 1)
        at.append(piece.start_s_m + ahead)
        curves = (piece.x, piece.y, piece.z)
        points.append(
            np.stack([a + ahead * (b + ahead * (c + ahead * d)) for a, b, c, d in curves], axis=-1)
        )
    if not points:
        return np.empty((0, 3))
    places, line = np.concatenate(at), np.concatenate(points)
    kept: np.ndarray = line[kept_points(places, line[:, None, :], ERROR_M - 2.0 * _PIECES_ERROR_M)]
    return kept


def route_points(route: RoadRoute, roads: RoadMap) -> np.ndarray:
    """Points of a route along the middles of its lanes [N, 3] [m]."""
    parts = [np.empty((0, 3)), *_legs(route, roads)]
    return np.concatenate(parts)


def _legs(route: RoadRoute, roads: RoadMap) -> Iterator[np.ndarray]:
    frames = list(roads.frames.values())
    for leg in route.legs:
        frame = frames[leg.road]
        low, high = sorted((leg.from_s_m, leg.to_s_m))
        low, high = max(low, 0.0), min(high, frame.road.length_m)
        line = []
        for number, cross in enumerate(frame.sections):
            start, end = cross.section.start_m, cross.section.end_m
            begin, stop = max(low, start), min(high, end)
            if begin >= stop:
                continue
            stations = section_stations(frame, number)
            inner = stations[(stations > begin) & (stations < stop)]
            s = np.concatenate([[begin], inner, [stop]])
            # The end of a section belongs to the next, which may lack the lane.
            at = np.clip(s, start, np.nextafter(end, 0.0))
            lane = leg.lane if cross.section.lane(leg.lane) is not None else 0
            pose = frame.lane_pose(lane, at)
            points = np.stack([pose.x_m, pose.y_m, pose.z_m + _ABOVE_M], axis=-1)
            line.append(points[kept_points(s, points[:, None, :], ERROR_M - _PIECES_ERROR_M)])
        if line:
            points = np.concatenate(line)
            yield points[::-1] if leg.to_s_m < leg.from_s_m else points


def _route(action: Action, roads: RoadMap, pose: tuple[float, float, float, float]) -> int:
    """Route that an action puts an entity on, -1: none."""
    if isinstance(action, AssignRouteAction):
        return action.route
    if not isinstance(action, AcquirePositionAction) or not action.routes:
        return -1
    x, y, z, heading = pose
    under = roads.lane_under(x, y, z)
    road = int(under.road)
    if road < 0:
        return -1
    frame = list(roads.frames.values())[road]
    along = float(frame.pose(float(under.s_m)).heading_rad)
    against = int(np.cos(heading - along) < 0.0)
    number = 2 * road + against
    return action.routes[number] if number < len(action.routes) else -1


def _placed(points: np.ndarray, pose: tuple[float, float, float, float]) -> np.ndarray:
    x, y, z, heading = pose
    c, s = np.cos(heading), np.sin(heading)
    turned = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    placed: np.ndarray = points @ turned + np.array([x, y, z])
    return placed


def _path(name: str, points: np.ndarray) -> PlayPath:
    lifted = points + np.array([0.0, 0.0, _ABOVE_M])
    return PlayPath(kind="trajectory", name=name[:TEXT_CHARS_MAX], points=packed_rows(lifted))
