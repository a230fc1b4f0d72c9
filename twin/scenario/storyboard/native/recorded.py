"""Recorded poses of an actor become a trajectory with times.

Between two poses a body moves evenly along a straight line, and turns evenly the shorter way. Its
height is that of the road below, as for everybody else; beside all roads it is 0.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from twin.scenario.storyboard.native.bodies import ActorBody
from twin.scenario.storyboard.native.ground import ScenarioGround, SpotError
from twin.scenario.storyboard.program.places import FixedPosition, Trajectory, TrajectoryPiece

_COLUMNS = 4
_COORDINATE_MAX_M = 1e5
_TIME_MAX_S = 86_400.0


def recorded_places(
    poses: list[list[float]], ahead_m: float, ground: ScenarioGround
) -> list[FixedPosition]:
    """Where the origin of a body is at each pose.

    Args:
        poses: rows of time [s], x, y [m] and heading [deg].
        ahead_m: how far ahead of the origin the point is that they are about [m].
        ground: the roads.

    Raises:
        SpotError: a row has other numbers, a value is out of range, or times do not rise.
    """
    rows = _checked(poses)
    heading = np.radians(rows[:, 3])
    x = rows[:, 1] - ahead_m * np.cos(heading)
    y = rows[:, 2] - ahead_m * np.sin(heading)
    under = ground.roads.lane_under(x, y)
    places = []
    for index in range(len(rows)):
        turn = math.remainder(float(heading[index]), 2.0 * math.pi)
        at = float(x[index]), float(y[index])
        road = int(under.road[index])
        if road < 0:
            places.append(FixedPosition(*at, 0.0, turn))
            continue
        s_m, t_m, lane = (float(under.s_m[index]), float(under.t_m[index]), int(under.lane[index]))
        z_m = float(ground.frame(road).pose(s_m, t_m).z_m)
        offset_m = t_m - ground.middle(road, lane, s_m)
        places.append(
            FixedPosition(
                *at, z_m, turn, road=road, s_m=s_m, t_m=t_m, lane=lane, lane_offset_m=offset_m
            )
        )
    return places


def recorded_trajectory(
    name: str, poses: list[list[float]], places: list[FixedPosition]
) -> Trajectory:
    """The trajectory through the places of poses, at their times."""
    pieces: list[TrajectoryPiece] = []
    along_m, heading = 0.0, places[0].heading_rad
    for index, (one, other) in enumerate(itertools.pairwise(places)):
        begin_s, end_s = poses[index][0], poses[index + 1][0]
        start, end = (one.x_m, one.y_m, one.z_m), (other.x_m, other.y_m, other.z_m)
        length_m = math.dist(start, end)
        turn = math.remainder(other.heading_rad - heading, 2.0 * math.pi)
        slope = 1.0 / length_m if length_m > 0.0 else 0.0
        x, y, z = ((a, (b - a) * slope, 0.0, 0.0) for a, b in zip(start, end, strict=True))
        pieces.append(
            TrajectoryPiece(
                along_m,
                length_m,
                x,
                y,
                z,
                (heading, turn * slope, 0.0, 0.0),
                begin_s,
                end_s - begin_s,
            )
        )
        along_m += length_m
        # Who turns on the spot has the new heading from the next piece on.
        heading += turn
    return Trajectory(name, False, True, tuple(pieces))


def start_speed_mps(poses: list[list[float]], places: list[FixedPosition]) -> float:
    """Speed between the first two poses [m/s]."""
    one, other = places[:2]
    way_m = math.dist((one.x_m, one.y_m, one.z_m), (other.x_m, other.y_m, other.z_m))
    return way_m / (poses[1][0] - poses[0][0])


def body_ahead_m(body: ActorBody, ego: bool) -> float:
    """How far ahead of its origin the point is that poses are about [m]."""
    return 0.0 if ego else body.centre_x_m


def _checked(poses: list[list[float]]) -> np.ndarray:
    if len(poses) < 2:
        raise SpotError("poses", f"given {len(poses)} poses, at least 2 needed")
    for index, row in enumerate(poses):
        if len(row) != _COLUMNS:
            words = "needed: time [s], x, y [m], heading [deg]"
            raise SpotError(f"poses.{index}", f"given {len(row)} numbers, {words}")
    rows = np.array(poses, float)
    for column, most, words in (
        (0, _TIME_MAX_S, "a time"),
        (1, _COORDINATE_MAX_M, "x"),
        (2, _COORDINATE_MAX_M, "y"),
        (3, 1e6, "a heading"),
    ):
        beyond = np.flatnonzero(~(np.abs(rows[:, column]) <= most))
        if len(beyond):
            value = rows[beyond[0], column]
            raise SpotError(f"poses.{beyond[0]}", f"{words} of {value:g}, allowed: up to {most:g}")
    later = np.flatnonzero(np.diff(rows[:, 0]) <= 0.0)
    if len(later) or rows[0, 0] < 0.0:
        index = int(later[0]) + 1 if len(later) else 0
        raise SpotError(f"poses.{index}", f"time {rows[index, 0]:g} s, times must rise from 0 on")
    return rows
